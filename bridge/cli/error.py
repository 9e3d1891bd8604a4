"""`tcbridge error`: what a return code means, and which event it is."""

from typing import TYPE_CHECKING, Annotated

import msgspec
from cyclopts import Parameter

from bridge.cli.exits import Exit
from bridge.cli.options import TEXTS_ONLY, Texts, catalog, note
from bridge.cli.show import clean, print_json
from bridge.core.conversion import SUCCESS_EVENT
from bridge.core.hresult import to_signed
from bridge.core.meanings import Meaning, meanings

if TYPE_CHECKING:
    from bridge.core.catalog import Catalog


def error(
    code: Annotated[
        str,
        Parameter(
            name="CODE",
            help="HRESULT, ADS code or Windows' number, decimal, 0x... or 16#..., or a name.",
            allow_leading_hyphen=True,
        ),
    ],
    /,
    *,
    common: Texts = TEXTS_ONLY,
) -> int:
    """Explain a return code: name, text, its forms, its event.

    A number that means several things shows them all: 2 is an ADS code and one
    of Windows. The built-in texts are English; class files bring others. Exit
    code 1: the number means nothing known. 2: neither a number nor a name.

    Try:
        tcbridge error 0x98110712
        tcbridge error ADS_E_NOTFOUND --json
    """
    settings = common.load()
    known = catalog(settings)
    found = meanings(code)
    for meaning in found:
        if common.json:
            print_json(_record(meaning, known, settings.lang))
        else:
            print("\n".join(_lines(meaning, known, settings.lang)), flush=True)
    if not found:
        note(f"{clean(code)} is no known HRESULT, ADS code or number of Windows")
    return Exit.OK if found else Exit.NO


def _text(meaning: Meaning, known: "Catalog", lang: str) -> str:
    event = meaning.event
    if event is None or known.entry(event.event_class, event.event_id) is None:
        return meaning.text
    return known.text(event.event_class, event.event_id, (), lang)


def _lines(meaning: Meaning, known: "Catalog", lang: str) -> list[str]:
    lines = [f"{meaning.name}: {clean(_text(meaning, known, lang))}"]
    if meaning.short_name != meaning.name:
        lines.append(f"  also called  {meaning.short_name}")
    if meaning.hresult is not None:
        signed = to_signed(meaning.hresult)
        lines.append(f"  HRESULT      0x{meaning.hresult:08X} = {signed}")
    if meaning.ads_code is not None:
        lines.append(f"  ADS code     0x{meaning.ads_code:X} = {meaning.ads_code}")
    if meaning.win32 is not None:
        lines.append(f"  Windows      0x{meaning.win32:X} = {meaning.win32}")
    return [*lines, *_event_lines(meaning, known, lang)]


def _event_lines(meaning: Meaning, known: "Catalog", lang: str) -> list[str]:
    event = meaning.event
    if event is None:
        return ["  event        none"]
    if event == SUCCESS_EVENT:
        return ["  event        SUCCESS_EVENT: no class, id 0, verbose"]
    entry = known.entry(event.event_class, event.event_id)
    name = f" {entry.name}" if entry is not None else ""
    return [
        f"  event        {event.event_id}{clean(name)}, {event.severity.name.lower()}",
        f"  event class  {clean(known.class_name(event.event_class, lang))} {event.event_class}",
    ]


def _record(meaning: Meaning, known: "Catalog", lang: str) -> dict[str, object]:
    event = meaning.event
    entry = known.entry(event.event_class, event.event_id) if event is not None else None
    return {
        **{name: value for name, value in msgspec.structs.asdict(meaning).items() if name != "event"},
        "text": _text(meaning, known, lang),
        "hresult_signed": to_signed(meaning.hresult) if meaning.hresult is not None else None,
        "event_class": event.event_class if event is not None else None,
        "event_id": event.event_id if event is not None else None,
        "severity": int(event.severity) if event is not None else None,
        "class_name": known.class_name(event.event_class, lang) if event is not None and entry is not None else None,
        "event_name": entry.name if entry is not None else None,
    }
