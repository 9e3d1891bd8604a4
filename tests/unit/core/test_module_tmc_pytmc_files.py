"""The module classes of the real class files inside the pytmc distribution: PLC programs of SLAC's projects.

Only its data is read: pytmc itself is never imported. The counts were taken from the files' text.
"""

from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import pytest

from bridge.core.module_tmc import read_modules
from bridge.core.module_tmc_writer import write_modules

SYMBOLS = {
    "KFEArbiter": 782,
    "plc_kfe_gmd_vac": 466,
    "plc_kfe_xgmd_vac": 435,
    "plc_kfe_xgmd_vac_sim": 344,
    "ArbiterPLC": 316,
    "lfe_motion": 2510,
    "motion_abstraction_sample": 522,
    "xpp_pulsepicker_motion": 508,
    "Library": 356,
    "tc_mot_example": 578,
    "XtesSxrPlc": 279,
}
"""Module to the number of its symbols, of the larger one where a name is there twice."""
ALL_SYMBOLS = 8203
ALL_PARAMETERS = 3
ALL_AREAS = 64


@pytest.mark.slow
def test_fourteen_plc_programs_load_and_survive_a_round_trip() -> None:
    """Each file has one module class; nothing is a problem, and what is written reads back equal."""
    try:
        listed = distribution("pytmc").files or []
    except PackageNotFoundError:
        pytest.skip("pytmc is not installed; make slow installs it")
    symbols: dict[str, int] = {}
    totals = [0, 0, 0, 0]
    for path in sorted(Path(str(each.locate())) for each in listed if each.suffix.lower() == ".tmc"):
        found = read_modules(path.read_bytes(), str(path))
        assert found.problems == ()
        assert read_modules(write_modules(found.modules, found.interfaces, found.library)) == found
        (module,) = found.modules
        assert module.class_id == "08500001-0000-0000-f000-000000000064"
        count = sum(len(area.symbols) for area in module.data_areas)
        symbols[module.name] = max(count, symbols.get(module.name, 0))
        for index, number in enumerate((1, count, len(module.parameters), len(module.data_areas))):
            totals[index] += number
    assert symbols == SYMBOLS
    assert totals == [14, ALL_SYMBOLS, ALL_PARAMETERS, ALL_AREAS]
