"Event classes as constants. Made by tcbridge from plant.tmc: do not edit, make it again."

from typing import Final as _Final

from bridge.core.events import EventDefinition as _Definition
from bridge.core.events import Severity as _Severity

__all__ = ["TC_EVENTS", "TC_EVENT_CLASSES"]


class TC_EVENTS:
    "One class for each event class, one constant for each of its events."

    class Faults:
        "Faults"

        LagError: _Final = _Definition("ad4adf83-39ab-40c0-a603-795c27820b17", 1, _Severity.ERROR)
        "Axis {0} lags {1} mm behind"
        DoorOpen: _Final = _Definition("ad4adf83-39ab-40c0-a603-795c27820b17", 2, _Severity.CRITICAL)
        "Safety door {0} is open"
        OilHot: _Final = _Definition("ad4adf83-39ab-40c0-a603-795c27820b17", 3, _Severity.WARNING)
        "Oil has {0} °C, allowed are {1}"

    class Line:
        "Production line"

        Stroke: _Final = _Definition("f2b25576-b463-434f-b26b-3cf6dd5e3527", 1, _Severity.VERBOSE)
        "Stroke {0} with {1} kN"
        Moved: _Final = _Definition("f2b25576-b463-434f-b26b-3cf6dd5e3527", 2, _Severity.VERBOSE)
        "Axis {0} moved to {1} mm"
        ToolWorn: _Final = _Definition("f2b25576-b463-434f-b26b-3cf6dd5e3527", 3, _Severity.WARNING)
        "Tool worn to {0} %"
        GripLost: _Final = _Definition("f2b25576-b463-434f-b26b-3cf6dd5e3527", 4, _Severity.ERROR)
        "Gripper of axis {0} lost part {1}"
        Homed: _Final = _Definition("f2b25576-b463-434f-b26b-3cf6dd5e3527", 5, _Severity.INFO)
        "Axis {0} is homed"


class TC_EVENT_CLASSES:
    "The GUID of each event class."

    Faults: _Final = "ad4adf83-39ab-40c0-a603-795c27820b17"
    Line: _Final = "f2b25576-b463-434f-b26b-3cf6dd5e3527"
