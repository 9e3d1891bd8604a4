"""The columns a filter's WHERE clause asks, as a table of its own: what a test needs to ask SQLite without the cache.

The encoding of missing values is the one that core/filters/sql.py states.
"""

from typing import Final

from bridge.core.events import AnyEvent

SCHEMA: Final = """CREATE TABLE events (
    unique_id INTEGER NOT NULL, target TEXT NOT NULL, kind TEXT NOT NULL, is_alarm INTEGER NOT NULL, event_class TEXT NOT NULL,
    event_id INTEGER NOT NULL, severity INTEGER NOT NULL, source_id INTEGER NOT NULL, source_name TEXT NOT NULL,
    has_source_name INTEGER NOT NULL, source_guid TEXT NOT NULL, json_attribute TEXT NOT NULL, time_ns INTEGER NOT NULL,
    time_raised_ns INTEGER NOT NULL, time_cleared_ns INTEGER NOT NULL, time_confirmed_ns INTEGER NOT NULL,
    raised INTEGER NOT NULL, confirmation_state INTEGER NOT NULL, vendor_id INTEGER NOT NULL, product_code INTEGER NOT NULL,
    revision_no INTEGER NOT NULL) STRICT"""


def row_of(event: AnyEvent, unique_id: int) -> tuple[int | str, ...]:
    """The event as a row of SCHEMA."""
    return (
        unique_id,
        event.target,
        event.kind,
        int(event.is_alarm),
        event.event_class,
        event.event_id,
        int(event.severity),
        -1 if event.source_id is None else event.source_id,
        event.source_name or "",
        int(event.source_name is not None),
        event.source_guid or "",
        event.json_attribute,
        event.time_ns,
        event.time_raised_ns,
        event.time_cleared_ns,
        event.time_confirmed_ns,
        int(event.raised),
        int(event.confirmation_state),
        -1 if event.vendor_id is None else event.vendor_id,
        -1 if event.product_code is None else event.product_code,
        -1 if event.revision_no is None else event.revision_no,
    )
