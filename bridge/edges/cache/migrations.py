"""What the cache file looks like: one SQL script per version of the file.

Rule 1: a script that was released is never changed; the next change of the tables is a new script at the end.
Rule 2: PRAGMA user_version is the number of scripts applied; APPLICATION_ID says that the file is ours.
Rule 3: a column that a filter can name is spelled like the event's attribute and is NOT NULL, because SQL's third truth value
is not the filter's. Missing is -1 for a number and '' for a text; has_source_name tells a missing name from an empty one.
Rule 4: `inexact_text` marks the rows whose columns are not what the event says, because SQLite stores no lone surrogates.
SQL says nothing about them; the predicate decides on `body`.

events  one row per message and per alarm transition. id is the order of arrival and is never used twice. unique_id is one per
        message and one per alarm life. body is the event as codec.encode() writes it (JSON), with all that has no column.
alarms  state as it is now, by key, with the unique_id of its life; dropping events never changes it.
answers what became of the last commands: a digest of each that was carried out, and the event it caused.
meta    facts of the file by name: what its writer wants to find again (session, next unique id, mark of a clean stop),
        `dropped_events` (how many events the size limit has cost so far) and `durable_commits`.
"""

from typing import Final

APPLICATION_ID: Final = 0x74634272
"""The bytes "tcBr" at offset 68 of the file."""

_V1: Final = """
CREATE TABLE events (
    id INTEGER PRIMARY KEY AUTOINCREMENT,
    unique_id INTEGER NOT NULL,
    arrival_ns INTEGER NOT NULL,
    kind TEXT NOT NULL,
    is_alarm INTEGER NOT NULL,
    target TEXT NOT NULL,
    session TEXT NOT NULL,
    seq INTEGER NOT NULL,
    key_seq INTEGER NOT NULL,
    event_class TEXT NOT NULL,
    event_id INTEGER NOT NULL,
    severity INTEGER NOT NULL,
    source_id INTEGER NOT NULL,
    source_name TEXT NOT NULL,
    has_source_name INTEGER NOT NULL,
    source_guid TEXT NOT NULL,
    json_attribute TEXT NOT NULL,
    time_ns INTEGER NOT NULL,
    time_raised_ns INTEGER NOT NULL,
    time_cleared_ns INTEGER NOT NULL,
    time_confirmed_ns INTEGER NOT NULL,
    raised INTEGER NOT NULL,
    confirmation_state INTEGER NOT NULL,
    vendor_id INTEGER NOT NULL,
    product_code INTEGER NOT NULL,
    revision_no INTEGER NOT NULL,
    inexact_text INTEGER NOT NULL,
    body BLOB NOT NULL
) STRICT;
CREATE UNIQUE INDEX events_by_number ON events (target, session, seq) WHERE seq > 0;
CREATE INDEX events_by_class ON events (event_class);
CREATE INDEX events_by_time ON events (time_ns);
CREATE INDEX events_by_life ON events (unique_id) WHERE is_alarm = 1;
CREATE INDEX events_inexact ON events (id) WHERE inexact_text;
CREATE TABLE alarms (
    key BLOB PRIMARY KEY NOT NULL,
    target TEXT NOT NULL,
    unique_id INTEGER NOT NULL,
    body BLOB NOT NULL
) STRICT;
CREATE TABLE meta (
    name TEXT PRIMARY KEY NOT NULL,
    value TEXT NOT NULL
) STRICT;
"""

_V2: Final = """
CREATE TABLE answers (
    number INTEGER PRIMARY KEY,
    question BLOB NOT NULL UNIQUE,
    session TEXT NOT NULL,
    seq INTEGER NOT NULL,
    created INTEGER NOT NULL
) STRICT;
"""

MIGRATIONS: Final = (_V1, _V2)
VERSION: Final = len(MIGRATIONS)
