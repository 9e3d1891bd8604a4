"""Who is meant: the ids of TcCOM, and their texts.

Rule 1: classes, libraries' classes and interfaces have GUIDs, in the one spelling of core.arguments.guid().
Rule 2: objects, parameters, contexts and categories have 32-bit numbers; their text is hexadecimal, "0x71010000".
Rule 3: an id is given once and never changes. 0 is no object.

Sources: the GVL of the Tc3_Module manual (5.1) for the free ids; its chapter 8.2 for the ids of ITComObject and ITcUnknown;
real `.tmc` files for those of ITcCyclic, ITcCyclicCaller, ITcADI, ITcWatchSource and of the parameter CyclicCaller;
TwinCAT's headers for ITComObjectServer and ITcTask; the EventLogger manual 9.2.1 for an id of a task (02010020). The manual
says that system modules have fixed ids and prints none: those of ours lie right below the free ids.
"""

import re
import uuid
from typing import Final, TypeAlias

from bridge.core.arguments import guid

ObjectId: TypeAlias = int
ParameterId: TypeAlias = int
ContextId: TypeAlias = int
CategoryId: TypeAlias = int
ClassId: TypeAlias = str
InterfaceId: TypeAlias = str

NO_OBJECT: Final[ObjectId] = 0
CREATE_NEW_ID: Final[ObjectId] = 0xFFFF_FFFF
"""Asks the object server for a new id (OTCID_CreateNewId)."""
FIRST_FREE_ID: Final[ObjectId] = 0x7101_0000
LAST_FREE_ID: Final[ObjectId] = 0x710F_FFFF
"""New ids are given from FIRST_FREE_ID to LAST_FREE_ID (OTCID_FirstFreeId, OTCID_LastFreeId)."""

OBJECT_SERVER_ID: Final[ObjectId] = 0x7100_0001
FIRST_SYSTEM_ID: Final[ObjectId] = 0x7100_0000
LAST_SYSTEM_ID: Final[ObjectId] = 0x7100_FFFF
"""Ids of our system modules: fixed, so that others find them without asking."""
FIRST_LOGGER_ID: Final[ObjectId] = 0x7100_0100
FIRST_RECORDER_ID: Final[ObjectId] = 0x7100_0200
FIRST_GATEWAY_ID: Final[ObjectId] = 0x7100_0300
FIRST_LISTENER_ID: Final[ObjectId] = 0x7100_0400
"""The first logger, recorder, gateway and listener of a plant; the next of its kind follows at the next number."""
FIRST_TASK_ID: Final[ObjectId] = 0x0201_0010
TASK_ID_STEP: Final = 0x10
"""Tasks are 0x02010010, 0x02010020 and so on, as in TwinCAT."""

ITC_UNKNOWN: Final[InterfaceId] = "00000001-0000-0000-e000-000000000064"
ITCOM_OBJECT: Final[InterfaceId] = "00000012-0000-0000-e000-000000000064"
ITCOM_OBJECT_SERVER: Final[InterfaceId] = "00000030-0000-0000-e000-000000000064"
ITC_TASK: Final[InterfaceId] = "02000002-0000-0000-e000-000000000064"
ITC_CYCLIC: Final[InterfaceId] = "03000010-0000-0000-e000-000000000064"
ITC_ADI: Final[InterfaceId] = "03000012-0000-0000-e000-000000000064"
ITC_WATCH_SOURCE: Final[InterfaceId] = "03000018-0000-0000-e000-000000000064"
ITC_CYCLIC_CALLER: Final[InterfaceId] = "0300001e-0000-0000-e000-000000000064"
PID_CYCLIC_CALLER: Final[ParameterId] = 0x0300_2060
"""The parameter that holds the id of the task that calls a cyclic module."""

_NUMBER: Final = re.compile(r"(?:0x|#x|16#)([0-9a-fA-F]{1,8})|([0-9]{1,10})")
_LIBRARY: Final = re.compile(r"[^|]+\|[^|]+\|[0-9]+(?:\.[0-9]+){0,3}")


class IdError(ValueError):
    """What is no id; says what was expected."""


def id_text(number: int) -> str:
    """A 32-bit id as people write it: "0x71010000"."""
    return f"0x{number:08X}"


def parse_id(text: str) -> int:
    """Read "0x71010000", "#x03002060" (as `.tmc` files write), "16#71010000" (as a PLC does) or a decimal number; IdError."""
    match = _NUMBER.fullmatch(text.strip())
    number = -1 if match is None else int(match[1], 16) if match[1] else int(match[2])
    if not 0 <= number <= 0xFFFF_FFFF:
        raise IdError(f"{text!r} is no 32-bit id; expected e.g. 0x71010000")
    return number


def is_object_id(number: int) -> bool:
    """Whether an object may have this id: 32 bits, and neither "none" nor "a new one"."""
    return NO_OBJECT < number < CREATE_NEW_ID


def versioned_class_id(class_id: ClassId, library: str) -> ClassId:
    """The class id of one version of a class: both ids the same always give the same; IdError for a library id of another form.

    library is "vendor|library|version", as F_GetClassIdVersioned takes it. How TwinCAT mixes the two is not published, so
    this is not its number: it is the UUID of version 5 of the library id in the name space of the class id.
    """
    if _LIBRARY.fullmatch(library) is None:
        raise IdError(f"{library!r} is no library id; expected 'vendor|library|version', e.g. 'Acme|Filters|1.0.0.0'")
    return str(uuid.uuid5(uuid.UUID(guid(class_id)), library))
