"""Return codes as events and back, against the tables in the manuals' text."""

import os
import re
from pathlib import Path

import pytest

from bridge.core import hresult
from bridge.core.builtin import BUILTIN, TC_GENERAL_ADS, TC_ROUTER, TC_RTIME, TC_SYSTEM, WIN32, builtin_catalog
from bridge.core.conversion import (
    SUCCESS_EVENT,
    ads_err_to_event_entry,
    event_entry_to_ads_err,
    event_entry_to_hresult_ads_err,
    event_entry_to_win32,
    hresult_ads_err_to_event_entry,
    win32_to_event_entry,
)
from bridge.core.events import EventDefinition, Severity

SHARED = Path(os.environ.get("TCBRIDGE_SHARED", Path(__file__).parents[3].parent / "shared"))
EVENTLOGGER, TE1000 = "003_436fa307038a0f32.txt", "000_84bf9adb23dd55e1.txt"
ROWS = (*hresult.GLOBAL, *hresult.ROUTER, *hresult.ADS, *hresult.RTIME)
NO_EVENT = {0x740: "ADSERR_CLIENT_ERROR", 0x756: "ADSERR_CLIENT_REQUESTCANCELLED"}
CLASSES = {  # the ADS codes of a group, as the manual delimits it, and the class of the real files
    range(0x0001, 0x0500): ("TcSystemEventClass", TC_SYSTEM),
    range(0x0500, 0x0700): ("TcRouterEventClass", TC_ROUTER),
    range(0x0700, 0x1000): ("TcGeneralAdsEventClass", TC_GENERAL_ADS),
    range(0x1000, 0x2000): ("TcRTimeEventClass", TC_RTIME),
}


def printed(name: str) -> list[tuple[int, int]]:
    """ADS code and HRESULT of every row that a manual prints; both print them side by side."""
    path = SHARED / "seeds" / name
    if not path.is_file():
        pytest.skip(f"the manual {path} is not here; TCBRIDGE_SHARED names the folder that holds it")
    rows = re.findall(r"\b(\d+)\s+0x(9811[0-9A-F]{4})\s+[A-Z]+_", path.read_text(encoding="utf-8"))
    return [(int(code), int(value, 16)) for code, value in rows]


@pytest.mark.parametrize("manual", [EVENTLOGGER, TE1000])
def test_every_code_the_manuals_print_converts_and_comes_back(manual: str) -> None:
    """31 global, 14 router, 75 ADS and 16 real-time codes: each has a row; all but two convert, and back to themselves."""
    rows = printed(manual)
    assert len(rows) == 31 + 14 + 75 + 16
    without = set()
    for code, value in rows:
        assert hresult.lookup(value) is not None
        entry = ads_err_to_event_entry(code)
        assert entry == hresult_ads_err_to_event_entry(value) == hresult_ads_err_to_event_entry(hresult.to_signed(value))
        if entry is None:
            without.add(code)
            continue
        assert event_entry_to_ads_err(entry) == code
        assert event_entry_to_hresult_ads_err(entry) == (value if code else hresult.S_OK)
    assert without == set(NO_EVENT)


@pytest.mark.parametrize("row", [row for row in ROWS if row.ads_code], ids=lambda row: str(row.name))
def test_a_code_is_an_event_of_its_class(row: hresult.Code) -> None:
    """The event has the class of the code's group, the code as id, severity Error and the row's text."""
    code = row.ads_code
    assert code is not None
    entry = ads_err_to_event_entry(code)
    if code in NO_EVENT:
        assert (entry, row.name) == (None, NO_EVENT[code])
        return
    ((name, event_class),) = [found for codes, found in CLASSES.items() if code in codes]
    assert entry == EventDefinition(event_class, code, Severity.ERROR)
    assert builtin_catalog().class_name(event_class) == name
    assert builtin_catalog().text(event_class, code).lower() == f"{row.text}.".lower()


def test_no_error_is_the_success_event() -> None:
    """ADS code 0, S_OK and 0x98110000 are SUCCESS_EVENT of the manual's 6.4.1; back it is 0, which is no failure."""
    assert SUCCESS_EVENT == ("00000000-0000-0000-0000-000000000000", 0, Severity.VERBOSE)
    assert ads_err_to_event_entry(0) == SUCCESS_EVENT
    assert hresult_ads_err_to_event_entry(0) == hresult_ads_err_to_event_entry(0x98110000) == SUCCESS_EVENT
    assert event_entry_to_ads_err(SUCCESS_EVENT) == 0
    assert event_entry_to_hresult_ads_err(SUCCESS_EVENT) == 0


@pytest.mark.parametrize("code", [-1, 0x1F, 0x4FF, 0x50E, 0x73A, 0x757, 0x1008, 0x2000, 10060, 0x98110712, 2**40])
def test_a_number_that_is_no_ads_code_has_no_event(code: int) -> None:
    """Gaps in the tables, numbers of Windows and HRESULTs given as ADS codes are None, never an exception."""
    assert ads_err_to_event_entry(code) is None


@pytest.mark.parametrize("code", [1, 183, 0x203, 0x80004001, 0x80070002, 0x98117012, 0x98110756, 0x712])
def test_an_hresult_of_another_facility_has_no_event(code: int) -> None:
    """Manual: the call fails when the facility is unknown. The misprinted 0x98117012 has no row."""
    assert hresult_ads_err_to_event_entry(code) is None


def test_an_hresult_has_32_bits() -> None:
    """More than that is the caller's fault."""
    with pytest.raises(ValueError, match="no HRESULT"):
        hresult_ads_err_to_event_entry(2**32)


def test_older_versions_of_a_class_convert_back() -> None:
    """A device with an older library sends the older GUID: same code. So do GUIDs known only as hidden, in any spelling."""
    older = [each for each in BUILTIN if each.name != "Win32EventClass"]
    assert len(older) == 7
    for each in older:
        for number, entry in each.events.items():
            definition = EventDefinition(each.guid, number, entry.severity)
            assert event_entry_to_ads_err(definition) == number
    assert event_entry_to_ads_err(EventDefinition("{EF57FA70-34C2-47F2-B661-D7FFBEC2C9A9}", 7, Severity.INFO)) == 7


@pytest.mark.parametrize(
    ("event_class", "event_id"),
    [
        ("54cc5482-ad79-4cdc-8c3e-b3983b36ed66", 1),  # nobody's class of codes
        ("not a GUID", 1),
        ("", 0),
        (TC_ROUTER, 0x712),  # a code of another class
        (TC_ROUTER, 1),
        (TC_SYSTEM, 0),
        (TC_GENERAL_ADS, 0x73A),
        ("00000000-0000-0000-0000-000000000000", 1),
        (WIN32, 10060),
    ],
)
def test_an_event_that_is_no_code_converts_to_none(event_class: str, event_id: int) -> None:
    """A class that is unknown, or an id that is no code of its group."""
    entry = EventDefinition(event_class, event_id, Severity.ERROR)
    assert event_entry_to_ads_err(entry) is None
    assert event_entry_to_hresult_ads_err(entry) is None


@pytest.mark.parametrize("row", hresult.WINSOCK, ids=lambda row: str(row.name))
def test_winsock_codes_of_the_manual_are_events_of_windows_class(row: hresult.Code) -> None:
    """The three codes have their event, with the row's name and text, and convert back."""
    entry = win32_to_event_entry(row.code)
    assert entry == EventDefinition(WIN32, row.code, Severity.ERROR)
    found = builtin_catalog().entry(WIN32, row.code)
    assert found is not None
    assert (found.name, found.display_text.lower()) == (row.name, f"{row.text}.".lower())
    assert event_entry_to_win32(entry) == row.code


def test_windows_codes() -> None:
    """By number or as HRESULT_FROM_WIN32; 0 is an event here; what Windows' class does not have is None."""
    assert win32_to_event_entry(2) == win32_to_event_entry(0x80070002) == EventDefinition(WIN32, 2, Severity.ERROR)
    assert win32_to_event_entry(0) == EventDefinition(WIN32, 0, Severity.VERBOSE)
    assert win32_to_event_entry(7) is None
    assert win32_to_event_entry(0x98110002) is None
    assert event_entry_to_win32(EventDefinition("1d0c4bac-ecf3-4f33-8f20-a12e77ab6387", 2, Severity.ERROR)) == 2
    assert event_entry_to_win32(EventDefinition(WIN32, 7, Severity.ERROR)) is None
    assert event_entry_to_win32(EventDefinition(TC_SYSTEM, 2, Severity.ERROR)) is None
