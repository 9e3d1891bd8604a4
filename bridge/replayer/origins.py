"""Where what is replayed came from: events and alarms say so, whatever they are folded into later."""

import msgspec

from bridge.core.alarms import Alarm
from bridge.core.events import Event, Origin
from bridge.edges.recording import StateFrame


def origin_of(item: Event | Alarm, realm: str) -> Origin:
    """Where something recorded came from; of what was a replay already, where that came from."""
    if item.origin is not None:
        return item.origin
    return Origin(realm=realm, session=item.session, seq=item.seq, key_seq=item.key_seq if isinstance(item, Event) else 0)


def replayed_frame(frame: StateFrame, target: str | None = None) -> StateFrame:
    """The keyframe with alarms that say where they came from, under another name if one is given."""
    target = frame.target if target is None else target
    alarms = tuple(
        msgspec.structs.replace(alarm, target=target, origin=origin_of(alarm, frame.realm)) for alarm in frame.alarms
    )
    return msgspec.structs.replace(frame, target=target, alarms=alarms)
