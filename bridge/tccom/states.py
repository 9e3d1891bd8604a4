"""Which states a module goes through, and what each transition may do: a table.

Rule 1: INIT, PREOP, SAFEOP, OP, and only steps to the neighbour. A longer way is walked step by step.
Rule 2: INIT is a state in passing: creating a module includes IP, and PI removes it.
Rule 3: what a step up has acquired, the step down gives back: OS undoes SO, SP undoes PS, PI undoes IP.
Rule 4: a step that fails undoes what it began. The module stays where the last completed step left it.

Source: Tc3_Module manual 8.1.1.2. The numbers of the states are those of TCOM_STATE.

What a hook may do:

    transition  hook    its work
    IP          on_ip   take parameters, allocate memory. Others may not exist yet: connecting to them is refused
    PS          on_ps   connect to others, open files; whatever takes long. A parent passes parameters on to its children
    SO          on_so   register with others, e.g. with a task. Nothing slow, nothing new allocated
    OS          on_os   undo SO: sign off from tasks and others. Nothing slow
    SP          on_sp   undo PS: let go of others, close files
    PI          on_pi   undo IP. Afterwards the object server forgets the module
"""

from enum import IntEnum, StrEnum
from typing import Final

import msgspec


class State(IntEnum):
    """TCOM_STATE, with its numbers."""

    INIT = 1
    PREOP = 2
    SAFEOP = 4
    OP = 8


class Transition(StrEnum):
    """The six steps between neighbours."""

    IP = "IP"
    PS = "PS"
    SO = "SO"
    OS = "OS"
    SP = "SP"
    PI = "PI"


class Step(msgspec.Struct, frozen=True):
    """A row: where a transition leads, and what it may do.

    undoes: the step up whose acquisitions it gives back; connects: whether the module may get references to others in it;
    real_time: whether it belongs to the real-time context, where nothing slow is done.
    """

    transition: Transition
    source: State
    target: State
    undoes: Transition | None
    connects: bool
    real_time: bool


STEPS: Final[tuple[Step, ...]] = (
    Step(Transition.IP, State.INIT, State.PREOP, None, connects=False, real_time=False),
    Step(Transition.PS, State.PREOP, State.SAFEOP, None, connects=True, real_time=False),
    Step(Transition.SO, State.SAFEOP, State.OP, None, connects=True, real_time=True),
    Step(Transition.OS, State.OP, State.SAFEOP, Transition.SO, connects=True, real_time=True),
    Step(Transition.SP, State.SAFEOP, State.PREOP, Transition.PS, connects=True, real_time=False),
    Step(Transition.PI, State.PREOP, State.INIT, Transition.IP, connects=False, real_time=False),
)
"""The whole state machine."""

_NEXT: Final = {(step.source, step.target > step.source): step for step in STEPS}


def path(source: State, target: State) -> tuple[Step, ...]:
    """The steps from one state to another, in order; none when they are the same."""
    steps: list[Step] = []
    while source != target:
        step = _NEXT[source, target > source]
        steps.append(step)
        source = step.target
    return tuple(steps)
