"""`tcbridge control`: who records and plays, and telling them something."""

import time
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import NETWORK, REALM, Network, open_bus, operator
from bridge.cli.show import Cell, clean, print_json, print_table
from bridge.config import HELP

if TYPE_CHECKING:
    from bridge.control import Present
    from bridge.core.control import ControlAnswer
    from bridge.edges.bus import Bus

CONTROL = Group("Control", sort_key=10)
_STEP_S = 0.02


def control(
    name: Annotated[str | None, Parameter(name="NAME", help="Of a recorder or a player. Default: list them.")] = None,
    command: Annotated[str, Parameter(name="COMMAND", help="What it shall do. Default: tell its status.")] = "status",
    value: Annotated[str | None, Parameter(name="VALUE", help="What the command needs.", allow_leading_hyphen=True)] = None,
    /,
    *,
    operator_name: Annotated[str | None, Parameter(name="--operator", help=HELP["operator"], group=CONTROL)] = None,
    comment: Annotated[str, Parameter(help="Why.", group=CONTROL)] = "",
    wait: Annotated[float, Parameter(help="Seconds to wait for it.", group=CONTROL, show_default=True)] = 3.0,
    realm: Annotated[str | None, REALM] = None,
    common: Network = NETWORK,
) -> int:
    """Tell a recorder or a player something while it runs.

    Without a NAME all of them are listed, of every realm or of --realm. Which
    commands one takes stands in its status. Exit code 1: it refused, with an
    HRESULT. 4: nobody answered.

    Try:
        tcbridge control
        tcbridge control replay-1a2b3c4d pause
        tcbridge control replay-1a2b3c4d seek 90
    """
    from bridge.control import NobodyError, tell
    from bridge.core.control import control_command

    settings = common.load(operator=operator_name, realm=realm)
    try:
        told = control_command(command, value)
    except ValueError as error:
        raise Usage(str(error)) from None
    with open_bus(settings) as bus:
        found = _found(bus, realm, name, wait)
        if name is None:
            return _list(bus, found, as_json=common.json)
        if len(found) > 1:
            raise Usage(f"{name} is in several realms, choose one with --realm: {', '.join(one.realm for one in found)}")
        if not found:
            raise NobodyError(name, realm)
        answer = tell(
            bus, name, told, realm=found[0].realm, operator=operator(settings), comment=comment, timeout_s=max(wait, 0.0)
        )
    _show(found[0], answer, as_json=common.json)
    return Exit.OK


def _found(bus: "Bus", realm: str | None, name: str | None, wait_s: float) -> "list[Present]":
    """Who is there; whoever has a name is waited for, and a list is made when all who may turn up had their time."""
    from bridge.control import present

    deadline = time.monotonic() + wait_s
    while True:
        found = present(bus, realm=realm, name=name)
        if (found and name is not None) or (name is None and not bus.undiscovered_s()) or time.monotonic() >= deadline:
            return found
        time.sleep(_STEP_S)


def _list(bus: "Bus", found: "list[Present]", *, as_json: bool) -> int:
    from bridge.control import NobodyError, tell
    from bridge.core.control import Status

    rows: list[list[Cell]] = []
    for one in found:
        try:
            facts = tell(bus, one.name, Status(), realm=one.realm, timeout_s=0).status
        except NobodyError:
            facts = {"state": "does not answer"}
        if as_json:
            print_json({"name": one.name, "role": one.role, "realm": one.realm, "status": facts})
        else:
            more = ", ".join(f"{fact} {_text(value)}" for fact, value in facts.items() if fact != "state" and value != "")
            rows.append([clean(one.name), one.role, clean(one.realm), _text(facts.get("state", "")), more])
    if not as_json:
        print_table(("Name", "Role", "Realm", "State", "Status"), rows)
    return Exit.OK


def _show(one: "Present", answer: "ControlAnswer", *, as_json: bool) -> None:
    if as_json:
        status = {"status": answer.status, "takes": answer.takes}
        print_json({"name": one.name, "role": one.role, "realm": one.realm, **status})
        return
    print(f"{one.role} {clean(one.name)} in realm {clean(one.realm)}")
    for fact, value in answer.status.items():
        if value != "":
            print(f"  {fact}: {_text(value)}")
    print(f"  takes: {', '.join(answer.takes)}")


def _text(value: object) -> str:
    match value:
        case bool():
            return "yes" if value else "no"
        case int():
            return f"{value:,}"
        case float():
            return f"{value:g}"
        case _:
            return clean(str(value))
