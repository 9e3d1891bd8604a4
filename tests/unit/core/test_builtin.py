"""The built-in classes: whole, with texts of their own, and the same as in real class files."""

import os
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

from bridge.core import hresult
from bridge.core.builtin import BUILTIN, TC_GENERAL_ADS, TC_ROUTER, TC_RTIME, TC_SYSTEM, WIN32, builtin_catalog
from bridge.core.catalog import EventClass, EventEntry
from bridge.core.events import Severity
from bridge.core.tmc import read_classes

SHARED = Path(os.environ.get("TCBRIDGE_SHARED", Path(__file__).parents[3].parent / "shared"))

COUNTS = {  # by hand, from the survey of real files
    "11f7fc20-dbf4-4daf-96c7-1fd6b6156b31": ("TcSystemEventClass", 28),
    "bb2a9999-102e-421a-8d3d-b0660e07b1fe": ("TcSystemEventClass", 30),
    "e3d84344-4cb3-44db-8d94-12f9ce0e2f90": ("TcRouterEventClass", 14),
    "e759605a-2341-48fc-9f3f-c8fa405c4b24": ("TcRouterEventClass", 14),
    "98bcb284-f932-4ea4-b58b-68a1f1c34192": ("TcGeneralAdsEventClass", 61),
    "7d760066-d373-4a0c-b0f1-328b1620b0f0": ("TcGeneralAdsEventClass", 73),
    "b63588ae-b30a-4dce-a44f-f929fb114944": ("TcRTimeEventClass", 16),
    "1d0c4bac-ecf3-4f33-8f20-a12e77ab6387": ("Win32EventClass", 37),
    "4abefbbf-6620-4349-91ad-e6110a3be851": ("Win32EventClass", 99),
}


def test_every_version_has_its_events() -> None:
    """Nine versions of five classes, each with as many events as its real one."""
    assert {each.guid: (each.name, len(each.events)) for each in BUILTIN} == COUNTS
    assert len(builtin_catalog()) == len(BUILTIN) == 9


def test_every_event_has_a_text_and_a_name_of_its_own() -> None:
    """No empty text, no placeholder, no name twice in a class; the key of an event is its id."""
    for each in BUILTIN:
        entries = each.events.values()
        assert all(number == entry.id for number, entry in each.events.items())
        assert len({entry.name for entry in entries}) == len(entries)
        assert all(entry.display_text and "{" not in entry.display_text for entry in entries)
        assert all(entry.display_text == entry.display_text.strip() for entry in entries)


def test_severity_is_error_but_for_success() -> None:
    """As in the real classes: Windows' code 0 is Verbose, everything else Error."""
    light = {(each.name, entry.id) for each in BUILTIN for entry in each.events.values() if entry.severity != Severity.ERROR}
    assert light == {("Win32EventClass", 0)}
    assert builtin_catalog().entry(WIN32, 0) == EventEntry(0, "ERROR_SUCCESS", Severity.VERBOSE, "Done without an error.")


@pytest.mark.parametrize(
    ("guid", "rows"),
    [(TC_SYSTEM, hresult.GLOBAL), (TC_ROUTER, hresult.ROUTER), (TC_GENERAL_ADS, hresult.ADS), (TC_RTIME, hresult.RTIME)],
)
def test_the_newest_versions_cover_the_manuals_tables(guid: str, rows: tuple[hresult.Code, ...]) -> None:
    """Each code is an event but for 0x0, 0x740 and 0x756, and the event says what the row says."""
    found = builtin_catalog().lookup(guid)
    assert found is not None
    codes = {row.ads_code: row.text for row in rows if row.ads_code not in (0, 0x740, 0x756)}
    assert found.events.keys() == codes.keys()
    for entry in found.events.values():
        assert entry.display_text.lower() == f"{codes[entry.id]}.".lower()


def test_each_name_has_one_newest_version() -> None:
    """send by name works, for every older version is hidden by the newest of its name."""
    newest = {name: builtin_catalog().newest(name).guid for name in builtin_catalog().names()}
    assert newest == {
        "TcSystemEventClass": TC_SYSTEM,
        "TcRouterEventClass": TC_ROUTER,
        "TcGeneralAdsEventClass": TC_GENERAL_ADS,
        "TcRTimeEventClass": TC_RTIME,
        "Win32EventClass": WIN32,
    }
    assert "8d937c5b-9a96-4a48-aa0b-bc30cc416a59" in builtin_catalog().guids("TcGeneralAdsEventClass")


def test_a_class_file_wins() -> None:
    """A class of the same GUID that is merged into the built-in ones replaces ours, the others stay."""
    theirs = EventClass(TC_RTIME, "TcRTimeEventClass", events={1: EventEntry(1, "Only", Severity.INFO, "theirs")})
    merged = builtin_catalog().merged([theirs])
    assert merged.text(TC_RTIME, 1) == "theirs"
    assert merged.entry(TC_RTIME, 4096) is None
    assert merged.text(TC_ROUTER, 1280) == "No locked memory for the router."
    assert len(merged) == len(BUILTIN)


def shape(found: EventClass) -> tuple[str, str, dict[int, tuple[str, Severity]], set[str]]:
    """What must be the same in a real file: all but the texts and the hides that we add."""
    hides = set(found.hides) - {"98bcb284-f932-4ea4-b58b-68a1f1c34192"}
    return found.guid, found.qualified_name, {entry.id: (entry.name, entry.severity) for entry in found.events.values()}, hides


def test_the_real_publisher_file_has_our_windows_class() -> None:
    """Beckhoff's publisher sample carries the older Win32EventClass: ids, names and severities are ours, texts its own."""
    path = SHARED / "data" / "tmc" / "beckhoff-publisher.tmc"
    if not path.is_file():
        pytest.skip(f"{path} is not here; TCBRIDGE_SHARED names the folder that holds it")
    real = {each.guid: each for each in read_classes(path.read_bytes()).classes}
    (guid,) = real.keys() & COUNTS.keys()
    ours = builtin_catalog().lookup(guid)
    assert ours is not None
    assert shape(real[guid]) == shape(ours)
    texts = [(entry.display_text, ours.events[entry.id].display_text) for entry in real[guid].events.values()]
    assert not [theirs for theirs, text in texts if theirs == text]


@pytest.mark.slow
def test_the_built_in_classes_are_those_of_real_files() -> None:
    """All nine versions are in pytmc's files: ids, names, severities and hides are ours. Only its data is read."""
    try:
        files = distribution("pytmc").files or []
    except PackageNotFoundError:
        pytest.skip("pytmc is not installed; make slow installs it")
    paths = [Path(str(each.locate())) for each in files if each.name in ("KFEArbiter.tmc", "xpp_pulsepicker_motion.tmc")]
    real = {each.guid: each for path in paths for each in read_classes(path.read_bytes()).classes if each.guid in COUNTS}
    assert {guid: shape(found) for guid, found in real.items()} == {each.guid: shape(each) for each in BUILTIN}
