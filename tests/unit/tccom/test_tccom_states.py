"""The state machine, walked along the text of the manual."""

import itertools

import pytest

from bridge.tccom.states import STEPS, State, Transition, path

T, S = Transition, State

MANUAL = [
    # 8.1.1.2: "there are only transitions to the next or previous step. This results in the state transitions: INIT to PREOP
    # (IP), PREOP to SAFEOP (PS) and SAFEOP to OP (SO). In the opposite direction ...: OP to SAFEOP (OS), SAFEOP to PREOP (SP)
    # and PREOP to INIT (PI)."
    # "During this transition the module cannot establish connections to other modules" (IP)
    (T.IP, S.INIT, S.PREOP, None, False, False),
    # "In this state transition the module can establish connections with other modules" (PS)
    (T.PS, S.PREOP, S.SAFEOP, None, True, False),
    # "Only the transition from SAFEOP to OP, the OP state and the transition from OP to SAFEOP take place in the real-time
    # context"; "resources can now be requested by other modules, and modules can register with other modules" (SO)
    (T.SO, S.SAFEOP, S.OP, None, True, True),
    # "All actions from the SO transition are reversed" (OS)
    (T.OS, S.OP, S.SAFEOP, T.SO, True, True),
    # "All actions from the PS transition are reversed" (SP)
    (T.SP, S.SAFEOP, S.PREOP, T.PS, True, False),
    # "All actions from the IP transition are reversed ... The module signs off from the Object Server" (PI)
    (T.PI, S.PREOP, S.INIT, T.IP, False, False),
]


def test_the_table_is_the_manuals_chapter() -> None:
    """Each row of the table says what chapter 8.1.1.2 says of its transition, and there is no other row."""
    rows = [(step.transition, step.source, step.target, step.undoes, step.connects, step.real_time) for step in STEPS]
    assert rows == MANUAL


@pytest.mark.parametrize(
    ("source", "target", "steps"),
    [
        (S.INIT, S.OP, "IP PS SO"),
        (S.OP, S.INIT, "OS SP PI"),
        (S.PREOP, S.OP, "PS SO"),
        (S.OP, S.PREOP, "OS SP"),
        (S.SAFEOP, S.PREOP, "SP"),
        (S.SAFEOP, S.SAFEOP, ""),
    ],
)
def test_a_longer_way_is_walked_step_by_step(source: State, target: State, steps: str) -> None:
    """From any state to any other, through all neighbours in between."""
    walked = path(source, target)
    assert " ".join(step.transition for step in walked) == steps
    assert all(one.target == after.source for one, after in itertools.pairwise(walked))


def test_states_have_the_numbers_of_tcom_state() -> None:
    """Other tools write them as numbers."""
    assert [int(state) for state in State] == [1, 2, 4, 8]
