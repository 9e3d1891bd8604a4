"""The real class files inside the pytmc distribution: SLAC's projects, with Beckhoff's own classes.

Only its data is read: pytmc itself is never imported.
"""

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

from bridge.core import class_toml
from bridge.core.catalog import Catalog, EventClass
from bridge.core.tmc import read_classes
from bridge.core.tmc_writer import write_classes

SUFFIXES = (".tmc", ".tsproj", ".xti")
OURS = {"LCLSGeneralEventClass": 5}
OLDER = {"TcSystemEventClass": 28, "TcGeneralAdsEventClass": 61, "TcRouterEventClass": 14, "TcRTimeEventClass": 16}
NEWER = {"TcSystemEventClass": 30, "TcGeneralAdsEventClass": 73, "TcRouterEventClass": 14, "Win32EventClass": 99}
COUNTS = {
    "KFEArbiter.tmc": OURS | OLDER | {"Win32EventClass": 37},
    "plc-kfe-gmd-vac.tsproj": {"VacEventClass": 4},
    "plc_kfe_gmd_vac.tmc": OURS,
    "lfe_motion.tmc": OURS | OLDER | {"Win32EventClass": 37},
    "motion_abstraction_sample.tmc": OURS,
    "xpp_pulsepicker_motion.tmc": OURS | NEWER | {"TcIPCDiagEventClass": 14, "TcIPCDiagPlcApiEventClass": 8},
    "Library.tmc": OURS,
    "tc_mot_example.tmc": OURS,
}
"""File to class to the number of its events; motion_abstraction_sample.tmc is there twice."""
ALL_CLASSES = 25
ALL_EVENTS = 594
GUIDS = 13
GUIDS_AND_NAMES = 403


def files() -> list[Path]:
    try:
        found = distribution("pytmc").files or []
    except PackageNotFoundError:
        pytest.skip("pytmc is not installed; make slow installs it")
    paths = sorted(Path(str(each.locate())) for each in found if each.suffix.lower() in SUFFIXES)
    return [path for path in paths if b"<EventId" in path.read_bytes()]


@pytest.mark.slow
def test_the_nine_files_of_pytmc_load_and_survive_a_round_trip() -> None:
    """Counts as in the files' text; every class is equal after it was written and read as TMC and as TOML."""
    names: list[str] = []
    classes: list[EventClass] = []
    for path in files():
        result = read_classes(path.read_bytes(), str(path))
        assert result.problems == ()
        assert {found.name: len(found.events) for found in result.classes} == COUNTS[path.name]
        assert read_classes(write_classes(result.classes)).classes == result.classes
        assert class_toml.read_classes(class_toml.write_classes(result.classes)).classes == result.classes
        names.append(path.name)
        classes += result.classes
    assert sorted(names) == sorted([*COUNTS, "motion_abstraction_sample.tmc"])
    assert len(classes) == ALL_CLASSES
    assert sum(len(found.events) for found in classes) == ALL_EVENTS
    assert len({found.guid for found in classes}) == GUIDS == len(Catalog(classes))
    assert len({(found.guid, entry.name) for found in classes for entry in found.events.values()}) == GUIDS_AND_NAMES
