"""Which event a return code is, and which code an event is (manual 6.1.3).

Rule 1: what does not convert is None, where the PLC functions answer FALSE. Codes without an event are ADSERR_CLIENT_ERROR
(0x740), ADSERR_CLIENT_REQUESTCANCELLED (0x756), and all that have no row in hresult.py.
Rule 2: no error is SUCCESS_EVENT (manual 6.4.1). S_OK and 0x98110000 both are; back it becomes 0, never the latter, whose sign
would make it a failure.
Rule 3: a code becomes an event of the newest class version; back, every version counts, also those known only because a newer
one hides them. The severity does not matter then.
Rule 4: Windows' numbers are no ADS codes (2 is ERR_NORTIME and ERROR_FILE_NOT_FOUND), so they have functions of their own.
"""

from typing import Final

from bridge.core import hresult
from bridge.core.arguments import ZERO_GUID, guid
from bridge.core.builtin import BUILTIN, TC_GENERAL_ADS, TC_ROUTER, TC_RTIME, TC_SYSTEM, WIN32, builtin_catalog
from bridge.core.events import EventDefinition, Severity

WIN32_FACILITY: Final = 0x8007_0000
"""High word of the HRESULT of a number of Windows."""


SUCCESS_EVENT: Final = EventDefinition(ZERO_GUID, 0, Severity.VERBOSE)
"""The event of no error: the empty class, id 0, Verbose."""

_GROUPS: Final = {
    TC_SYSTEM: hresult.GLOBAL,
    TC_ROUTER: hresult.ROUTER,
    TC_GENERAL_ADS: hresult.ADS,
    TC_RTIME: hresult.RTIME,
}
_NEWEST: Final = {row.ads_code: newest for newest, rows in _GROUPS.items() for row in rows if row.ads_code}
"""ADS return code to the class of its kind."""
_NAMES: Final = {each.guid: each.name for each in BUILTIN}
_VERSIONS: Final = {
    old: newest
    for newest in (*_GROUPS, WIN32)
    for each in BUILTIN
    if each.name == _NAMES[newest]
    for old in (each.guid, *each.hides)
}
"""Every GUID a class of codes ever had to its newest one."""


def ads_err_to_event_entry(code: int) -> EventDefinition | None:
    """The event of an ADS return code such as 0x712; None when it has none. AdsErr_TO_TcEventEntry."""
    return SUCCESS_EVENT if code == 0 else _definition(_NEWEST.get(code), code)


def hresult_ads_err_to_event_entry(code: int) -> EventDefinition | None:
    """The event of an ADS code's HRESULT, signed or not, such as 0x98110712; None when it has none or is none of ADS.

    HRESULTAdsErr_TO_TcEventEntry, which fails in the same way when the facility is unknown.
    """
    unsigned = hresult.from_signed(code)
    if unsigned == hresult.S_OK:
        return SUCCESS_EVENT
    return ads_err_to_event_entry(unsigned & 0xFFFF) if unsigned & 0xFFFF_0000 == hresult.ADS_FACILITY else None


def event_entry_to_ads_err(entry: EventDefinition) -> int | None:
    """The ADS return code of an event; None when its class is none of the ADS codes' or has no such code.

    TcEventEntry_TO_AdsErr.
    """
    if entry.event_id == 0:
        return 0 if _guid(entry) == ZERO_GUID else None
    newest = _VERSIONS.get(_guid(entry))
    return entry.event_id if newest is not None and _NEWEST.get(entry.event_id) == newest else None


def event_entry_to_hresult_ads_err(entry: EventDefinition) -> int | None:
    """The unsigned HRESULT of an event as event_entry_to_ads_err(): 0x98110712, or S_OK. TcEventEntry_TO_HRESULTAdsErr."""
    code = event_entry_to_ads_err(entry)
    return hresult.from_ads(code) if code else code


def win32_to_event_entry(code: int) -> EventDefinition | None:
    """The event of a number of Windows or Winsock (2, 10060), or of its HRESULT (0x80070002); None when it has none."""
    number = code & 0xFFFF if hresult.from_signed(code) & 0xFFFF_0000 == WIN32_FACILITY else code
    return _definition(WIN32, number)


def event_entry_to_win32(entry: EventDefinition) -> int | None:
    """Windows' number of an event; None when its class is not that of Windows' codes or has no such number."""
    known = _VERSIONS.get(_guid(entry)) == WIN32 and builtin_catalog().entry(WIN32, entry.event_id) is not None
    return entry.event_id if known else None


def _definition(event_class: str | None, event_id: int) -> EventDefinition | None:
    found = builtin_catalog().entry(event_class, event_id) if event_class is not None else None
    return EventDefinition(event_class, event_id, found.severity) if event_class is not None and found is not None else None


def _guid(entry: EventDefinition) -> str:
    try:
        return guid(entry.event_class)
    except ValueError:
        return ""
