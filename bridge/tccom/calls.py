"""What is asked and answered about objects over the bus: the payloads of @objects, in msgpack.

Rule 1: everything that an object offers is a call of an interface's method. Beside it there are holding and letting go,
creating (which holds), and describing.
Rule 2: the key is @objects/{access}/{session}: what the question needs, and which object server is meant. So Zenoh's access
rules can tell reading from calling, and no question reaches a server that was started later.
Rule 3: a question has an id. What changes something is done once per id and server; reading may be done again.
Rule 4: an interface comes with its fingerprint, "" from callers who did not declare it. The arguments are a map by name.
"""

from enum import StrEnum
from typing import Final, TypeAlias

import msgspec

from bridge.core.events import U32
from bridge.tccom.general import ClassInfo, IDataAreas, IObject, IObjectServer, ITask, IWatchSource
from bridge.tccom.identity import ClassId, InterfaceId, ObjectId
from bridge.tccom.interfaces import Interface, describe, known_interface
from bridge.tccom.states import State

MSGPACK: Final = "application/vnd.msgpack"
OBJECTS_VERB: Final = "@objects"
HOLDER: Final = "holder"
"""The role of a token that says: who shows it holds objects of this target."""


class Access(StrEnum):
    """What a question needs. read: changes nothing. set: parameters, symbols, names. call: methods, and holding objects.
    state: transitions, creating, deleting.
    """

    READ = "read"
    SET = "set"
    CALL = "call"
    STATE = "state"


_ROWS: Final[tuple[tuple[Interface[object], Access, tuple[str, ...]], ...]] = (
    (IObject, Access.READ, ("get_object_id", "get_object_name", "get_parent_id", "get_state", "get_parameter")),
    (IObject, Access.SET, ("set_object_name", "set_parent_id", "set_parameter")),
    (IObject, Access.STATE, ("set_state",)),
    (IDataAreas, Access.READ, ("read_symbol",)),
    (IWatchSource, Access.READ, ("read_values",)),
    (IDataAreas, Access.SET, ("write_symbol",)),
    (IObjectServer, Access.READ, ("objects", "object_info", "classes", "class_info")),
    (IObjectServer, Access.STATE, ("create_instance", "delete_instance")),
    (ITask, Access.READ, ("task_info",)),
)
_ACCESS: Final = {(describe(owner).id, name): access for owner, access, names in _ROWS for name in names}


def access_of(interface_id: InterfaceId, method: str) -> Access:
    """What calling this method needs: of the general interfaces, derived ones too, as the table says, of others `call`."""
    info = known_interface(interface_id)
    owners = (interface_id,) if info is None else (interface_id, *info.bases)
    return next((_ACCESS[owner, method] for owner in owners if (owner, method) in _ACCESS), Access.CALL)


class Call(msgspec.Struct, frozen=True, kw_only=True, tag_field="do", tag="call"):
    """Call a method; handle: of an object that the owner holds, 0 is whichever object has the id now."""

    id: str
    object_id: ObjectId
    interface: InterfaceId
    method: str
    arguments: msgspec.Raw
    fingerprint: str = ""
    owner: str = ""
    handle: int = 0


class Hold(msgspec.Struct, frozen=True, kw_only=True, tag_field="do", tag="hold"):
    """Hold an object for an owner, until released or until the owner is gone; answered with Held."""

    id: str
    owner: str
    object_id: ObjectId
    interface: InterfaceId
    fingerprint: str = ""


class Create(msgspec.Struct, frozen=True, kw_only=True, tag_field="do", tag="create"):
    """Create an object and hold it; answered with Held. transient: letting go of it deletes it."""

    id: str
    owner: str
    class_id: ClassId
    interface: InterfaceId
    object_id: ObjectId
    parent_id: ObjectId
    state: State
    name: str = ""
    parameters: dict[str | int, object] = {}
    transient: bool = False
    fingerprint: str = ""


class Release(msgspec.Struct, frozen=True, kw_only=True, tag_field="do", tag="release"):
    """Let go of what is held."""

    id: str
    owner: str
    handle: int


class Describe(msgspec.Struct, frozen=True, kw_only=True, tag_field="do", tag="describe"):
    """Tell what an object is; answered with ObjectText."""

    id: str
    object_id: ObjectId


Question: TypeAlias = Call | Hold | Create | Release | Describe


class Held(msgspec.Struct, frozen=True, kw_only=True):
    """The handle under which an owner holds an object, and what the object offers."""

    handle: int
    object_id: ObjectId
    interfaces: tuple[InterfaceId, ...]


class MethodText(msgspec.Struct, frozen=True, kw_only=True):
    """A method as people read it: name and type of each parameter, those that may be left out, and what it gives back."""

    name: str
    parameters: dict[str, str]
    optional: tuple[str, ...]
    returns: str


class InterfaceText(msgspec.Struct, frozen=True, kw_only=True):
    """An interface as people read it."""

    id: InterfaceId
    name: str
    fingerprint: str
    methods: tuple[MethodText, ...]


class ObjectText(msgspec.Struct, frozen=True, kw_only=True):
    """What an object is, for those who declare nothing of it: its class and what can be called."""

    about: ClassInfo
    interfaces: tuple[InterfaceText, ...]


class CallAnswer(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What became of a question: the HRESULT, the value or why there is none, and who answered.

    unheld: the handle is not known (any more); nothing was done.
    """

    session: str
    result: U32 = 0
    detail: str = ""
    value: msgspec.Raw = msgspec.Raw(b"\xc0")
    unheld: bool = False
