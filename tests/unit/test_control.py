"""A recorder or a player is told something over the bus, and answers."""

import threading
from collections.abc import Iterator

import msgspec
import pytest

from bridge import AdsError, open_bus
from bridge.control import ANSWERS_KEPT, PLAYER, RECORDER, Control, NameTakenError, NobodyError, present, tell
from bridge.core import keys
from bridge.core.control import (
    CONTROLS,
    ControlAnswer,
    ControlQuestion,
    Facts,
    Pause,
    Rate,
    Seek,
    Split,
    Status,
    Step,
    Stop,
    control_command,
)
from bridge.core.hresult import ADS_E_BUSY, ADS_E_INVALIDPARM, ADS_E_SRVNOTSUPP
from bridge.edges.bus import ALONE, Bus


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus that nobody else is on."""
    with open_bus(ALONE) as alone:
        yield alone


class Machine:
    """A program that notes what it was told."""

    def __init__(self) -> None:
        self.told: list[ControlQuestion] = []
        self.error: Exception | None = None

    def carry_out(self, question: ControlQuestion) -> None:
        if self.error is not None:
            raise self.error
        self.told.append(question)

    def status(self) -> Facts:
        return {"state": "playing", "told": len(self.told)}


@pytest.fixture
def machine() -> Machine:
    return Machine()


@pytest.fixture
def control(bus: Bus, machine: Machine) -> Iterator[Control]:
    """A player called night, which takes three commands beside status."""
    with Control(bus, "night", PLAYER, machine.carry_out, machine.status, takes=(Pause, Seek, Stop), realm="r") as made:
        yield made


def test_a_command_is_carried_out_and_the_status_after_it_is_answered(bus: Bus, machine: Machine, control: Control) -> None:
    """Operator, client and comment go with it."""
    answer = tell(bus, "night", Seek("90"), realm="r", operator="shift leader", comment="again")
    (question,) = machine.told
    assert question.command == Seek("90")
    assert (question.operator, question.comment) == ("shift leader", "again")
    assert question.client != ""
    assert (answer.result, answer.session, answer.status) == (0, control.session, {"state": "playing", "told": 1})


def test_status_changes_nothing_and_says_what_is_taken(bus: Bus, machine: Machine, control: Control) -> None:
    """The program itself is not asked to do anything."""
    answer = tell(bus, "night", Status(), realm="r")
    assert answer.status == {"state": "playing", "told": 0}
    assert answer.takes == ("status", "pause", "seek", "stop")
    assert machine.told == []


@pytest.mark.parametrize(
    ("error", "code", "detail"),
    [(AdsError(ADS_E_BUSY, "not now"), ADS_E_BUSY, "not now"), (ValueError("no such time"), ADS_E_INVALIDPARM, "no such time")],
)
@pytest.mark.usefixtures("control")
def test_what_the_program_refuses_is_an_hresult(bus: Bus, machine: Machine, error: Exception, code: int, detail: str) -> None:
    """Its own, or ADS_E_INVALIDPARM for a value that it cannot use."""
    machine.error = error
    with pytest.raises(AdsError, match=detail) as refused:
        tell(bus, "night", Pause(), realm="r")
    assert refused.value.code == code


@pytest.mark.usefixtures("control")
def test_a_fault_of_the_program_is_answered_too(bus: Bus, machine: Machine) -> None:
    """The reason reaches the asker; the program answers on."""
    machine.error = RuntimeError("the belt is torn")
    with pytest.raises(NobodyError, match="RuntimeError: the belt is torn"):
        tell(bus, "night", Pause(), realm="r", timeout_s=0)
    machine.error = None
    assert tell(bus, "night", Pause(), realm="r").result == 0


@pytest.mark.usefixtures("control")
def test_a_command_that_is_not_taken_is_refused(bus: Bus, machine: Machine) -> None:
    """A player does not split files."""
    with pytest.raises(AdsError, match="a player takes no split") as refused:
        tell(bus, "night", Split(), realm="r")
    assert refused.value.code == ADS_E_SRVNOTSUPP
    assert machine.told == []


def _ask(bus: Bus, command: str, question: object) -> list[ControlAnswer | str]:
    key = keys.verb_key("r", "night", "@control", command)
    answers = bus.ask(key, question if isinstance(question, bytes) else msgspec.json.encode(question))
    return [a.payload.decode() if a.error else msgspec.json.decode(a.payload, type=ControlAnswer) for a in answers]


@pytest.mark.usefixtures("control")
def test_the_same_id_twice_is_done_once(bus: Bus, machine: Machine) -> None:
    """It gets the same answer; for another command the id is refused, and so is none. The oldest ids are forgotten."""
    question = ControlQuestion(id="1", command=Pause())
    assert _ask(bus, "pause", question) == _ask(bus, "pause", question)
    assert len(machine.told) == 1
    for other in (ControlQuestion(id="1", command=Stop()), ControlQuestion(id="", command=Stop())):
        (refused,) = _ask(bus, "stop", other)
        assert isinstance(refused, ControlAnswer)
        assert refused.result == ADS_E_INVALIDPARM
    for number in range(ANSWERS_KEPT):
        _ask(bus, "pause", ControlQuestion(id=f"id {number}", command=Pause()))
    _ask(bus, "pause", question)
    assert len(machine.told) == ANSWERS_KEPT + 2


@pytest.mark.usefixtures("control")
def test_access_is_by_command(bus: Bus, machine: Machine) -> None:
    """Asked on the key of another command it is refused; so is what is no command at all."""
    assert _ask(bus, "pause", ControlQuestion(id="1", command=Stop())) == ["stop was asked on the key of pause"]
    for bad in (
        b"",
        b"[" * 5000,
        b"\xff",
        b'{"id":"1","command":{"do":"fly"}}',
        b'{"id":"1","command":{"do":"step","events":0}}',
    ):
        (refused,) = _ask(bus, "pause", bad)
        assert isinstance(refused, str)
        assert refused.startswith("no command")
    assert machine.told == []


def test_who_is_there_is_listed(bus: Bus, machine: Machine, control: Control) -> None:
    """By realm, name and role; who has closed is not there any more."""
    with Control(bus, "day", RECORDER, machine.carry_out, machine.status, takes=()):
        assert [(one.realm, one.name, one.role) for one in present(bus)] == [
            ("live", "day", "recorder"),
            ("r", "night", "player"),
        ]
        assert [one.session for one in present(bus, realm="r")] == [control.session]
        assert present(bus, name="noon") == []
    assert [one.name for one in present(bus)] == ["night"]
    with pytest.raises(NobodyError, match="'day' answers in realm live"):
        tell(bus, "day", Status(), timeout_s=0)


@pytest.mark.usefixtures("control")
def test_a_name_is_taken_once_per_realm(bus: Bus, machine: Machine) -> None:
    """A recorder of the same name in the same realm is refused; in another realm, or when the first is gone, it is not."""
    with pytest.raises(NameTakenError, match="'night' is the name of a player in realm r already"):
        Control(bus, "night", RECORDER, machine.carry_out, machine.status, takes=(), realm="r")
    Control(bus, "night", RECORDER, machine.carry_out, machine.status, takes=()).close()
    Control(bus, "night", RECORDER, machine.carry_out, machine.status, takes=()).close()


def test_a_program_told_to_stop_answers_before_it_goes(bus: Bus) -> None:
    """close() waits for the answer that is being given."""
    stopped, told = threading.Event(), threading.Event()
    order: list[str] = []

    def carry_out(question: ControlQuestion) -> None:
        told.set()
        assert stopped.wait(10)
        order.append("done")

    control = Control(bus, "night", PLAYER, carry_out, lambda: {"state": "stopping"}, takes=(Stop,))

    def program() -> None:
        assert told.wait(10)
        threading.Timer(0.05, stopped.set).start()
        control.close(10)
        order.append("closed")

    thread = threading.Thread(target=program)
    thread.start()
    assert tell(bus, "night", Stop(), timeout_s=0).status == {"state": "stopping"}
    thread.join()
    assert order == ["done", "closed"]


@pytest.mark.parametrize(
    ("name", "value", "command"),
    [
        ("pause", None, Pause()),
        ("step", None, Step()),
        ("step", "5", Step(5)),
        ("rate", "0.5", Rate(0.5)),
        ("seek", "9", Seek("9")),
    ],
)
def test_a_command_is_written_as_a_name_and_a_value(name: str, value: str | None, command: object) -> None:
    """The value is that of its one field."""
    assert control_command(name, value) == command


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("fly", None, "'fly' is no command; expected one of status, pause"),
        ("pause", "1", "pause takes no value"),
        ("seek", None, "seek needs a value: to"),
        ("rate", None, "rate needs a value$"),
        ("step", "0", "step: .*>= 1"),
        ("rate", "fast", "rate: Expected `float`"),
        ("rate", "-1", "rate: .*>= 0"),
    ],
)
def test_a_wrong_command_is_told(name: str, value: str | None, reason: str) -> None:
    """Which, and what was expected."""
    with pytest.raises(ValueError, match=reason):
        control_command(name, value)


def test_every_command_has_one_field_at_most() -> None:
    """So that NAME COMMAND VALUE is enough for a person."""
    assert all(len(msgspec.structs.fields(kind)) <= 1 and kind.__doc__ for kind in CONTROLS.values())
