"""`tcbridge modules` beside a running object server: what is shown, set, moved and called, and what each failure is."""

import json
from collections.abc import Callable, Iterator
from typing import Protocol

import msgspec
import pytest

from bridge.cli import run
from bridge.core.hresult import ADS_E_OUTOFRANGE, S_FALSE, AdsError
from bridge.edges.bus import BusConfig, open_bus
from bridge.tccom import Answer, DataArea, Module, ObjectServer, Parameter, Settable, State, interface
from bridge.tccom.calls import Access
from bridge.tccom.service import ObjectService

Run = Callable[..., tuple[int, str, str]]


@interface("7a1f5a0e-1111-4c60-8f0e-1d1d1d1d0031")
class IMixer(Protocol):
    """Mixes."""

    def mix(self, parts: list[float], name: str = "") -> Answer[dict[str, float]]: ...
    def wait(self) -> Answer[None]: ...


class Outputs(msgspec.Struct):
    """Symbols."""

    total: float = 1.5


class Mixer(Module, IMixer):
    """Mixes what it is given."""

    class_id = "7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1031"
    gain = Parameter(0x1, float, default=1.0, settable=Settable.INIT | Settable.OP)
    recipe = Parameter(0x2, str, default="plain")
    outputs = DataArea(1, Outputs, writable=True)

    def mix(self, parts: list[float], name: str = "") -> Answer[dict[str, float]]:
        if not parts:
            raise AdsError(ADS_E_OUTOFRANGE, "nothing to mix")
        return Answer({name or "sum": sum(parts) * self.gain})

    def wait(self) -> Answer[None]:
        return Answer(None, S_FALSE)


@pytest.fixture
def at_work(bus_config: BusConfig, capsys: pytest.CaptureFixture[str]) -> Iterator[Run]:
    """Runs a command beside an object server of plc1 with two mixers and one that is called like another."""

    def command(*arguments: str, target: str = "plc1") -> tuple[int, str, str]:
        options = ("--target", target, "--scouting-group", bus_config.scouting_group)
        code = run(["modules", *arguments, *options])
        out, err = capsys.readouterr()
        return code, out, err

    with open_bus(bus_config) as bus, ObjectServer() as server, ObjectService(server, bus, "plc1"):
        server.add(Mixer(), object_id=0x71010000, name="Mixer", state=State.OP)
        server.add(Mixer(), object_id=0x71010001, name="Twin")
        server.add(Mixer(), object_id=0x71010002, name="Twin", parent_id=0x71010000)
        with ObjectService(server, bus, "closed", allow=frozenset({Access.READ})):
            yield command


def test_list_and_show(at_work: Run) -> None:
    """As a table, and as JSON with everything."""
    code, out, _ = at_work("list")
    assert code == 0
    assert [line.split()[:4] for line in out.splitlines()[1:]] == [
        ["0x71000001", "ObjectServer", "ServerObject", "OP"],
        ["0x71010000", "Mixer", "Mixer", "OP"],
        ["0x71010001", "Twin", "Mixer", "PREOP"],
        ["0x71010002", "Twin", "Mixer", "PREOP"],
    ]
    assert out.splitlines()[-1].split()[4] == "0x71010000"
    code, out, _ = at_work("show", "Mixer")
    assert "Mixer (0x71010000) is in OP; class Mixer 7a1f5a0e-1111-4c60-8f0e-1d1d1d1d1031" in out
    assert "mix(parts: list[float], [name: str])" in out
    assert [line.split() for line in out.splitlines() if line.startswith("parameter")] == [
        ["parameter", "0x00000001", "gain", "float", "1.0", "init", "and", "op"],
        ["parameter", "0x00000002", "recipe", "str", "plain", "init"],
    ]
    code, out, _ = at_work("show", "0x71010000", "--json")
    shown = json.loads(out)
    assert (shown["state"], shown["parameters"], shown["symbols"]) == (
        "op",
        {"gain": 1.0, "recipe": "plain"},
        {"outputs.total": 1.5},
    )


def test_state_param_and_call(at_work: Run) -> None:
    """Each in words and as JSON."""
    assert at_work("state", "0x71010001", "op") == (0, "Twin is in OP\n", "")
    assert json.loads(at_work("state", "0x71010001", "--json")[1]) == {"name": "Twin", "object_id": 0x71010001, "state": "op"}
    assert at_work("param", "Mixer", "gain", "2") == (0, "2.0\n", "")
    assert at_work("param", "Mixer", "0x1") == (0, "2.0\n", "")
    assert at_work("param", "Mixer", "outputs.total", "7")[1] == "7.0\n"
    assert at_work("call", "Mixer", "mix", "parts=[1,2]", "name=a b")[1] == '{"a b":6.0}\n'
    assert at_work("call", "Mixer", "IMixer.wait") == (0, "", "S_FALSE\n")
    told = json.loads(at_work("call", "Mixer", "mix", "parts=[1]", "--json")[1])
    assert told == {"name": "Mixer", "method": "mix", "result": "S_OK", "value": {"sum": 2.0}}


REFUSALS = [
    (1, "ADS_E_OUTOFRANGE (0x98110734): out of range: nothing to mix", ("call", "Mixer", "mix", "parts=[]")),
    (1, "ADS_E_INVALIDSTATE", ("param", "Mixer", "recipe", "rich")),
    (1, "ADS_E_NOTFOUND", ("param", "Mixer", "volume")),
    (1, "ADS_E_INVALIDPARM", ("call", "Mixer", "mix", "part=[]")),
    (2, "no module Mixxer; there are ObjectServer, Mixer, Twin, Twin", ("show", "Mixxer")),
    (2, "Twin is the name of several; choose one by its id: 0x71010001, 0x71010002", ("state", "Twin")),
    (2, "no method stir; there are", ("call", "Mixer", "stir")),
    (2, "'parts': expected NAME=VALUE", ("call", "Mixer", "mix", "parts")),
    (2, "'run' is no state; expected one of init, preop, safeop, op", ("state", "Mixer", "run")),
]


def test_refusals(at_work: Run) -> None:
    """1 is what the module says, 2 is wrong usage; both say why."""
    for code, message, arguments in REFUSALS:
        done, out, err = at_work(*arguments)
        assert (done, out, message in err) == (code, "", True), err


def test_nobody_there_and_nothing_allowed(at_work: Run) -> None:
    """4 is nobody; what is switched off is refused."""
    code, out, err = at_work("list", "--wait", "0.3", target="plc9")
    assert (code, out) == (4, "")
    assert err == "tcbridge: target 'plc9' has no object server; these have one, choose with --target: closed, plc1\n"
    code, out, err = at_work("list", "--wait", "0.3", "--realm", "elsewhere")
    assert (code, out, err) == (4, "", "tcbridge: target 'plc1' has no object server\n")
    assert at_work("list", target="closed")[0] == 0
    code, _, err = at_work("state", "Mixer", "preop", target="closed")
    assert (code, "ADS_E_ACCESSDENIED (0x98110723): access denied: closed does not allow state" in err) == (1, True)
