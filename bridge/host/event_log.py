"""What a module asks of a logger: an interface, so that an interface pointer is all it needs, here or on another machine.

    log = InterfacePointer(0x10, IEventLog)

    def on_so(self) -> None:
        self.log.send_message(CLASS, 1, "info", self.object_id, self.name)

Rule 1: the source of an event is the module that sends it: its object id and its name.
Rule 2: an alarm is known by event class, event id and source. Raising creates it when there is none; what it is already, it
answers with S_FALSE, so that nobody needs to know how it stands before.
Rule 3: arguments are plain data: truths, numbers, texts.
"""

from typing import Protocol, TypeAlias

from bridge.config import SeverityName
from bridge.tccom.identity import ObjectId
from bridge.tccom.interfaces import Answer, interface

EventArguments: TypeAlias = tuple[bool | int | float | str, ...]


@interface("5c3a6d0e-6f0b-4d0c-9a43-2f1de0a7c001")
class IEventLog(Protocol):
    """Messages and alarms of modules."""

    def send_message(
        self,
        event_class: str,
        event_id: int,
        severity: SeverityName,
        source_id: ObjectId,
        source_name: str = "",
        arguments: EventArguments = (),
        json_attribute: str = "",
    ) -> Answer[None]: ...
    def raise_alarm(
        self,
        event_class: str,
        event_id: int,
        severity: SeverityName,
        source_id: ObjectId,
        source_name: str = "",
        arguments: EventArguments = (),
        with_confirmation: bool = False,
        json_attribute: str = "",
    ) -> Answer[None]: ...
    def clear_alarm(
        self,
        event_class: str,
        event_id: int,
        source_id: ObjectId,
        source_name: str = "",
        reset_confirmation: bool = False,
    ) -> Answer[None]: ...
    def is_raised(self, event_class: str, event_id: int, source_id: ObjectId, source_name: str = "") -> Answer[bool]: ...
