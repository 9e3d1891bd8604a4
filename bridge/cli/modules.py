"""`tcbridge modules list | show | state | param | call`: the modules of a running plant, over the bus."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

import msgspec
from cyclopts import Group, Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, note, open_bus
from bridge.cli.show import Cell, clean, print_json, print_table

if TYPE_CHECKING:
    from bridge.tccom.calls import InterfaceText, MethodText, ObjectText
    from bridge.tccom.general import ObjectInfo
    from bridge.tccom.proxy import RemoteObjects

MODULES: Final = Group("Modules", sort_key=10)
_Object: TypeAlias = Annotated[str, Parameter(name="OBJECT", help="Name of a module, or its object id, e.g. 0x71010000.")]
_Wait: TypeAlias = Annotated[float, Parameter(help="Seconds to wait for an answer.", group=MODULES, show_default=True)]
WAIT_S: Final = 3.0


def list_(*, wait: _Wait = WAIT_S, common: Common = COMMON) -> int:
    """List the modules of a target and their states.

    Exit code 4: nobody answers for the target's modules.

    Try:
        tcbridge modules list --target plc1
    """

    def work(remote: "RemoteObjects") -> int:
        from bridge.tccom.identity import NO_OBJECT, id_text

        rows: list[list[Cell]] = []
        for info in remote.objects():
            if common.json:
                print_json(_record(info))
                continue
            parent = "" if info.parent_id == NO_OBJECT else id_text(info.parent_id)
            cells = (id_text(info.object_id), clean(info.name), info.class_name, info.state.name, parent)
            rows.append([*cells, str(info.references)])
        if not common.json:
            print_table(("Id", "Name", "Class", "State", "Parent", "Held"), rows)
        return Exit.OK

    return _with_remote(common, wait, work)


def show(object_: _Object, /, *, wait: _Wait = WAIT_S, common: Common = COMMON) -> int:
    """Show one module: state, parameters, symbols of data areas, interfaces with their methods.

    Try:
        tcbridge modules show Calculation --target plc1
    """

    def work(remote: "RemoteObjects") -> int:
        info = _find(remote, object_)
        text = remote.describe(info.object_id)
        parameters = {one.name: _parameter(remote, info.object_id, one.name) for one in text.about.parameters}
        symbols = {one.path: remote.read_symbol(info.object_id, one.path) for one in text.about.symbols}
        if common.json:
            print_json({**_record(info), "parameters": parameters, "symbols": symbols, "interfaces": text.interfaces})
        else:
            _print(info, text, parameters, symbols)
        return Exit.OK

    return _with_remote(common, wait, work)


def state(
    object_: _Object,
    state_: Annotated[str | None, Parameter(name="STATE", help="preop, safeop, op, or init: delete it.")] = None,
    /,
    *,
    wait: _Wait = WAIT_S,
    common: Common = COMMON,
) -> int:
    """Tell the state of a module, or move it to another, step by step.

    Exit code 1: a step failed, and the module is where the last one left it.

    Try:
        tcbridge modules state Calculation safeop
    """

    def work(remote: "RemoteObjects") -> int:
        from bridge.tccom.states import State

        info = _find(remote, object_)
        now = info.state
        if state_ is not None:
            if state_.upper() not in State.__members__:
                raise Usage(f"{state_!r} is no state; expected one of {', '.join(one.name.lower() for one in State)}")
            now = State[state_.upper()]
            remote.set_state(info.object_id, now)
        if common.json:
            print_json({"name": info.name, "object_id": info.object_id, "state": now.name.lower()})
        else:
            print(f"{clean(info.name)} is in {now.name}")
        return Exit.OK

    return _with_remote(common, wait, work)


def param(
    object_: _Object,
    key: Annotated[str, Parameter(name="PARAMETER", help="Its name or id; or a symbol, as area.symbol.")],
    value: Annotated[
        str | None,
        Parameter(name="VALUE", help="JSON, or text as it is. Default: tell it.", allow_leading_hyphen=True),
    ] = None,
    /,
    *,
    wait: _Wait = WAIT_S,
    common: Common = COMMON,
) -> int:
    """Tell or set a parameter of a module, or a symbol of its data areas.

    Exit code 1: refused, e.g. because it is not settable in this state.

    Try:
        tcbridge modules param Counter step 5
        tcbridge modules param Counter outputs.total
    """

    def work(remote: "RemoteObjects") -> int:
        info = _find(remote, object_)
        areas = {one.path.partition(".")[0] for one in remote.describe(info.object_id).about.symbols}
        symbol = key.partition(".")[0] in areas
        its_key = key if symbol else _key(key)
        if value is not None and isinstance(its_key, str) and symbol:
            remote.write_symbol(info.object_id, its_key, _plain(value))
        elif value is not None:
            remote.set_parameter(info.object_id, its_key, _plain(value))
        now = remote.read_symbol(info.object_id, key) if symbol else remote.get_parameter(info.object_id, its_key)
        if common.json:
            print_json({"name": info.name, "object_id": info.object_id, "parameter": key, "value": now})
        else:
            print(_shown(now))
        return Exit.OK

    return _with_remote(common, wait, work)


def call(
    object_: _Object,
    method: Annotated[str, Parameter(name="METHOD", help="Its name; with the interface's, as ICalculation.addition.")],
    arguments: Annotated[
        tuple[str, ...],
        Parameter(name="ARGUMENTS", help="NAME=VALUE each; the value is JSON, or text as it is.", allow_leading_hyphen=True),
    ] = (),
    /,
    *,
    wait: _Wait = WAIT_S,
    common: Common = COMMON,
) -> int:
    """Call a method of a module and print what it gives back.

    Exit code 1: it answered a negative HRESULT. 4: no answer came; whether it
    was carried out is not known.

    Try:
        tcbridge modules call Calculation addition a=1 b=2
    """

    def work(remote: "RemoteObjects") -> int:
        from bridge.core.hresult import S_OK, name_of

        given: dict[str, object] = {}
        for argument in arguments:
            name, equals, text = argument.partition("=")
            if not equals:
                raise Usage(f"{argument!r}: expected NAME=VALUE")
            given[name] = _plain(text)
        info = _find(remote, object_)
        found = _method(remote.describe(info.object_id), method)
        answer = remote.call(info.object_id, found[0].id, found[1].name, given)
        if common.json:
            print_json({"name": info.name, "method": found[1].name, "result": name_of(answer.result), "value": answer.value})
        else:
            if answer.result != S_OK:
                note(name_of(answer.result))
            if answer.value is not None:
                print(_shown(answer.value))
        return Exit.OK

    return _with_remote(common, wait, work)


def _with_remote(common: Common, wait_s: float, work: "Callable[[RemoteObjects], int]") -> int:
    """Reach the modules of the target; what nobody answers is another exit code than what somebody refuses."""
    import time

    from bridge.core.hresult import ADS_E_TIMEOUT, AdsError
    from bridge.logger.presence import OBJECTS, targets_of
    from bridge.tccom.proxy import RemoteObjects

    settings = common.load()
    with open_bus(settings) as bus, RemoteObjects(bus, settings.one_target, realm=settings.realm, timeout_s=wait_s) as remote:
        try:
            remote.session(time.monotonic() + wait_s)
        except AdsError as error:
            others = ", ".join(clean(each) for each in sorted(targets_of(bus, settings.realm, role=OBJECTS)))
            note(f"tcbridge: {error.detail}{others and f'; these have one, choose with --target: {others}'}")
            return Exit.UNKNOWN
        try:
            return work(remote)
        except AdsError as error:
            if error.code != ADS_E_TIMEOUT:
                raise
            note(f"tcbridge: {error}")
            return Exit.UNKNOWN


def _find(remote: "RemoteObjects", text: str) -> "ObjectInfo":
    """The object of a name or id. Usage when there is none, or when the name has several."""
    from bridge.tccom.identity import id_text

    there = remote.objects()
    key = _key(text)
    found = [info for info in there if key in (info.object_id, info.name)]
    if len(found) == 1:
        return found[0]
    if found:
        raise Usage(
            f"{text} is the name of several; choose one by its id: {', '.join(id_text(one.object_id) for one in found)}"
        )
    raise Usage(f"no module {text}; there are {', '.join(clean(info.name) for info in there)}")


def _method(text: "ObjectText", name: str) -> "tuple[InterfaceText, MethodText]":
    """The method of a name, in the newest interface that has it."""
    owner, _, last = name.rpartition(".")
    for interface in text.interfaces:
        for method in interface.methods:
            if method.name == last and owner in ("", interface.name, interface.id):
                return interface, method
    known = ", ".join(f"{interface.name}.{method.name}" for interface in text.interfaces for method in interface.methods)
    raise Usage(f"no method {name}; there are {known}")


def _key(text: str) -> int | str:
    from bridge.tccom.identity import IdError, parse_id

    try:
        return parse_id(text)
    except IdError:
        return text


def _plain(text: str) -> object:
    try:
        value: object = msgspec.json.decode(text)
    except msgspec.DecodeError:
        return text
    return value


def _shown(value: object) -> str:
    return clean(value) if isinstance(value, str) else clean(msgspec.json.encode(value).decode())


def _parameter(remote: "RemoteObjects", object_id: int, name: str) -> object:
    """Its value; None for one that was not given yet."""
    from bridge.core.hresult import ADS_E_NOTINIT, AdsError

    try:
        return remote.get_parameter(object_id, name)
    except AdsError as error:
        if error.code != ADS_E_NOTINIT:
            raise
        return None


def _record(info: "ObjectInfo") -> dict[str, object]:
    record: dict[str, object] = msgspec.to_builtins(info)
    return record | {"state": info.state.name.lower()}


def _print(info: "ObjectInfo", text: "ObjectText", parameters: dict[str, object], symbols: dict[str, object]) -> None:
    from bridge.tccom.identity import id_text

    kind = f"{info.class_name} {info.class_id}".rstrip()
    print(f"{clean(info.name)} ({id_text(info.object_id)}) is in {info.state.name}; class {kind}")
    if text.about.description:
        print(f"  {clean(text.about.description)}")
    rows: list[list[Cell]] = [
        ["parameter", id_text(one.id), one.name, one.type, _shown(parameters[one.name]), " and ".join(one.settable) or "never"]
        for one in text.about.parameters
    ]
    rows += [
        ["symbol", "", one.path, one.type, _shown(symbols[one.path]), "always" if one.writable else "never"]
        for one in text.about.symbols
    ]
    if rows:
        print_table(("Kind", "Id", "Name", "Type", "Value", "Settable"), rows)
    print_table(
        ("Interface", "Method"),
        [[interface.name, _signature(method)] for interface in text.interfaces for method in interface.methods],
    )


def _signature(method: "MethodText") -> str:
    given = (f"[{name}: {kind}]" if name in method.optional else f"{name}: {kind}" for name, kind in method.parameters.items())
    return f"{method.name}({', '.join(given)}) -> {method.returns}"
