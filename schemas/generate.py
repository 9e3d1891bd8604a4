"""Write the schemas and the golden vectors: what others need to speak this wire in any language. Run by `make schemas`.

files() is all of it, as text by path; tests/unit/test_schemas.py compares it with what is committed. VECTORS says by hand which
filters take each event: a generator that asked the code would prove nothing.
"""

import json
from pathlib import Path
from typing import Final, NamedTuple

import msgspec

from bridge.core import codec, keys
from bridge.core.arguments import ZERO_GUID, Argument, ArgumentType, EventReference
from bridge.core.class_offer import ClassesPart, ClassesQuestion
from bridge.core.control import ControlAnswer, ControlQuestion
from bridge.core.events import (
    AlarmCleared,
    AlarmConfirmed,
    AlarmDisposed,
    AlarmRaised,
    AnyEvent,
    ConfirmationState,
    MessageSent,
    Origin,
    Severity,
)
from bridge.core.questions import (
    ClearLogAnswer,
    ClearLogQuestion,
    CommandAnswer,
    CommandQuestion,
    LogPart,
    LogQuestion,
    StatePart,
)
from bridge.core.sequence import Beat, Missing

HERE: Final = Path(__file__).parent
CLASS: Final = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
OTHER: Final = "5819b654-acc7-4328-a54f-a5886769f484"
T0: Final = 1_795_336_200_123_456_700
"""2026-11-22T08:30:00.1234567Z."""
S: Final = 1_000_000_000
T, C = ArgumentType, ConfirmationState

TYPES: Final[dict[str, tuple[type[msgspec.Struct], str]]] = {
    "beat": (Beat, "put on @beat/{session}: a sender's numbers"),
    "missing": (Missing, "asked on @sent/{session}: which events somebody missed"),
    "state-part": (StatePart, "answered on @state"),
    "log-question": (LogQuestion, "asked on @log"),
    "log-part": (LogPart, "answered on @log"),
    "classes-question": (ClassesQuestion, "asked on @classes"),
    "classes-part": (ClassesPart, "answered on @classes"),
    "command-question": (CommandQuestion, "asked on @do/{command}"),
    "command-answer": (CommandAnswer, "answered on @do/{command}"),
    "clear-log-question": (ClearLogQuestion, "asked on @do/clear_log"),
    "clear-log-answer": (ClearLogAnswer, "answered on @do/clear_log"),
    "control-question": (ControlQuestion, "asked on @control/{command}"),
    "control-answer": (ControlAnswer, "answered on @control/{command}"),
}
"""The payloads beside events, by file name. They may use $ref; an event's schema may not."""


class Vector(NamedTuple):
    """An event, what it is about, and filters that take it or do not."""

    name: str
    about: str
    event: AnyEvent
    taken_by: tuple[str, ...]
    left_by: tuple[str, ...]


VECTORS: Final = (
    Vector(
        "message-smallest",
        "Only what must be there; all else has its default. The sender does not number.",
        MessageSent(target="plc1", event_class=CLASS, event_id=0, severity=Severity.VERBOSE),
        (
            "",
            "is_message",
            "kind = message_sent",
            "severity = verbose",
            "time_ns is empty",
            "source_id is empty",
            "event_id = 0",
        ),
        (
            "is_alarm",
            "is_raised",
            "severity > verbose",
            "json_attribute is not empty",
            "source_name = ''",
            "source_name != 'x'",
        ),
    ),
    Vector(
        "message-full",
        "A numbered message with source, arguments and a JSON attribute.",
        MessageSent(
            target="plc1",
            event_class=CLASS,
            event_id=7,
            severity=Severity.INFO,
            session="5f1c2a905f1c2a90",
            seq=41,
            key_seq=3,
            time_ns=T0,
            source_id=139468800,
            source_name="MAIN.fbAxis",
            source_guid=OTHER,
            arguments=(Argument.of(3), Argument.of("X")),
            json_attribute='{"axis": 3, "name": "X", "limits": [0, 2.5], "a/b": true}',
        ),
        (
            f"event_class = {CLASS} and event_id in (1, 7)",
            f"event_class = '{{{CLASS.upper()}}}'",
            "source.name like '%fbaxis'",
            "source.id = 139468800",
            f"source.guid = {OTHER}",
            "json('/axis') = 3",
            "json('/limits/1') > 2",
            "json('/name') = 'X' and json('/a~1b') = true",
            "time between 2026-11-22T08:30:00Z and 2026-11-22T08:30:01Z",
            "target = 'plc1'",
            "not severity >= warning",
        ),
        (
            f"event_class = {OTHER}",
            "source.name like 'fbaxis%'",
            "source.name like 'MAIN_'",
            "json('/axis') > 3",
            "json('/none') = 3",
            "json('/none') != 3",
            "target = 'PLC1'",
            "time > 2026-11-22T08:30:01Z",
            "event_id between 8 and 9",
        ),
    ),
    Vector(
        "source-absent-and-empty",
        "Object id 0, the empty name and the zero GUID are there: not the same as absent.",
        MessageSent(
            target="plc1",
            event_class=CLASS,
            event_id=1,
            severity=Severity.INFO,
            time_ns=1,
            source_id=0,
            source_name="",
            source_guid=ZERO_GUID,
        ),
        ("source.id = 0", "source.name = ''", f"source.guid = {ZERO_GUID}", "source.name is empty", "time_ns = 1"),
        ("source.id is empty", "source.name is not empty", "source.guid is empty", "source.name like '_%'"),
    ),
    Vector(
        "source-name-only",
        "One part of the source is there, the others are absent.",
        MessageSent(target="plc1", event_class=CLASS, event_id=1, severity=Severity.INFO, source_name="MAIN"),
        ("source.id is empty and source.guid is empty and source.name = 'MAIN'", "not source.id = 0"),
        ("source.id = 0", f"source.guid = {ZERO_GUID}", "source.id >= 0"),
    ),
    Vector(
        "argument-types",
        "Every type of TcEventArgumentType, in the order of its number, and one that nobody knows.",
        MessageSent(
            target="plc1",
            event_class=CLASS,
            event_id=2,
            severity=Severity.INFO,
            arguments=(
                Argument.of("", T.UNDEFINED),
                Argument.of(True),
                Argument.of(-(2**7), T.INT8),
                Argument.of(-(2**15), T.INT16),
                Argument.of(-(2**31), T.INT32),
                Argument.of(-(2**63), T.INT64),
                Argument.of(2**8 - 1, T.UINT8),
                Argument.of(2**16 - 1, T.UINT16),
                Argument.of(2**32 - 1, T.UINT32),
                Argument.of(2**64 - 1, T.UINT64),
                Argument.of(0.1, T.FLOAT),
                Argument.of(0.1, T.DOUBLE),
                Argument.of("°", T.CHAR),
                Argument.of("€", T.WCHAR),
                Argument.of("text", T.STRING),
                Argument.of("wide €", T.WSTRING),
                Argument.of(EventReference(5, OTHER)),
                Argument.of("{0}", T.FORMAT_STRING),
                Argument.of(134_008_985_475_030_000, T.EXTERNAL_TIMESTAMP),
                Argument.of(bytes(range(0, 256, 51)), T.BLOB),
                Argument.of(b"\x00\xff", T.ADS_NOTIFICATION_STREAM),
                Argument.of("utf-8 €", T.UTF8_STRING),
                Argument.of("utf-16 €", T.UTF16_STRING),
                Argument.of("utf-32 €", T.UTF32_STRING),
                Argument(999, "carried as it came"),
            ),
        ),
        ("event_id = 2",),
        ("event_id != 2",),
    ),
    Vector(
        "argument-numbers",
        "Numbers that JSON's own cannot hold or many readers round; false; a reference within the class; empty text and blob.",
        MessageSent(
            target="plc1",
            event_class=CLASS,
            event_id=3,
            severity=Severity.INFO,
            arguments=(
                Argument.of(float("nan")),
                Argument.of(float("inf")),
                Argument.of(float("-inf"), T.FLOAT),
                Argument.of(-0.0),
                Argument.of(5e-324),
                Argument.of(9_007_199_254_740_993),
                Argument.of(2**63 - 1),
                Argument.of(0, T.EXTERNAL_TIMESTAMP),
                Argument.of(False),
                Argument.of(EventReference(2**32 - 1)),
                Argument.of(""),
                Argument.of(b""),
            ),
        ),
        ("event_id >= 3 and event_id <= 3",),
        ("event_id < 3 or event_id > 3",),
    ),
    Vector(
        "numbers-largest",
        "Every number of an event at its upper bound; readers that use doubles for integers will not get these right.",
        AlarmConfirmed(
            target="plc1",
            event_class=CLASS,
            event_id=2**32 - 1,
            severity=Severity.CRITICAL,
            session="s",
            seq=2**63 - 1,
            key_seq=2**63 - 1,
            time_ns=2**63 - 1,
            source_id=2**32 - 1,
            confirmation_state=C.CONFIRMED,
            time_raised_ns=2**63 - 1,
            time_cleared_ns=2**63 - 1,
            time_confirmed_ns=2**63 - 1,
            vendor_id=2**32 - 1,
            product_code=2**32 - 1,
            revision_no=2**32 - 1,
        ),
        (
            "event_id = 4294967295",
            "time_confirmed = 9223372036854775807",
            "is_ethercat_device",
            "time_cleared > 9223372036854775806",
        ),
        ("event_id < 4294967295", "time_raised < 9223372036854775807", "is_active"),
    ),
    Vector(
        "unicode",
        "Letters beyond ASCII in every text, the names of the key too; quotes, line ends, NUL; LIKE folds ASCII letters only.",
        MessageSent(
            target="Zelle/3 @Öl",
            event_class=CLASS,
            event_id=4,
            severity=Severity.WARNING,
            source_name="MÄIN.\u212a'\"\\\n\t\0🙂",
            arguments=(Argument.of("Öl\u2028🙂\0"),),
            json_attribute='{"ä": "\\u00f6\\ud83d\\ude42"}',
            comment="für später",
        ),
        ("target = 'Zelle/3 @Öl'", "source.name like 'mÄin%'", "json('/ä') = 'ö🙂'", "source.name like '%''%'"),
        ("source.name like 'mäin%'", "source.name like '%k%'", "target = 'zelle/3 @Öl'", "json('/ä') = '\\u00f6'"),
    ),
    Vector(
        "json-attribute-invalid",
        "The JSON attribute is the exact text that was given; this one is no JSON, and a pointer into it finds nothing.",
        MessageSent(
            target="plc1",
            event_class=CLASS,
            event_id=5,
            severity=Severity.ERROR,
            json_attribute="{'axis': 3, NaN} {\"axis\": 3}",
        ),
        ("json_attribute is not empty", "json('/axis') is empty", "json_attribute like '%NaN%'", "not json('/axis') = 3"),
        ("json('/axis') = 3", "json('/axis') != 4", "json('') is not empty"),
    ),
    Vector(
        "alarm-raised",
        "An alarm with confirmation begins: raised, waiting. The example of docs/wire.md.",
        AlarmRaised(
            target="plc1",
            event_class=CLASS,
            event_id=7,
            severity=Severity.ERROR,
            session="5f1c2a90",
            seq=41,
            key_seq=3,
            time_ns=T0,
            source_id=139468800,
            source_name="MAIN.fbAxis",
            arguments=(Argument.of(3), Argument.of("X")),
            json_attribute='{"axis":3}',
            raised=True,
            confirmation_state=C.WAIT_FOR_CONFIRMATION,
            time_raised_ns=T0,
        ),
        (
            "is_alarm and is_raised and is_active and is_wait_for_confirmation",
            "kind = alarm_raised",
            "confirmation_state = wait_for_confirmation",
            "time_raised = '2026-11-22T08:30:00.1234567Z'",
            "time_cleared is empty and time_confirmed is empty",
            "severity >= error and source.name like '%Main%' and json('/axis') = 3",
        ),
        (
            "is_message",
            "kind = alarm_cleared",
            "confirmation_state in (confirmed, reset)",
            "time_raised < 2026-11-22T08:30:00Z",
        ),
    ),
    Vector(
        "alarm-confirmed",
        "Confirmed while raised, by a person: who, from where and why.",
        AlarmConfirmed(
            target="plc1",
            event_class=CLASS,
            event_id=7,
            severity=Severity.ERROR,
            session="5f1c2a90",
            seq=42,
            key_seq=4,
            time_ns=T0 + 10 * S,
            source_id=139468800,
            source_name="MAIN.fbAxis",
            raised=True,
            confirmation_state=C.CONFIRMED,
            time_raised_ns=T0,
            time_confirmed_ns=T0 + 10 * S,
            operator="night shift",
            client="hmi-2",
            comment="pump is being changed",
        ),
        (
            "is_raised and is_active and not is_wait_for_confirmation",
            "confirmation_state = confirmed",
            "time_confirmed > 2026-11-22T08:30:10Z",
        ),
        ("is_wait_for_confirmation", "kind != alarm_confirmed", "confirmation_state = reset"),
    ),
    Vector(
        "alarm-cleared",
        "Cleared, confirmed before: the occurrence is over.",
        AlarmCleared(
            target="plc1",
            event_class=CLASS,
            event_id=7,
            severity=Severity.ERROR,
            session="5f1c2a90",
            seq=43,
            key_seq=5,
            time_ns=T0 + 20 * S,
            source_id=139468800,
            source_name="MAIN.fbAxis",
            confirmation_state=C.CONFIRMED,
            time_raised_ns=T0,
            time_cleared_ns=T0 + 20 * S,
            time_confirmed_ns=T0 + 10 * S,
        ),
        (
            "kind = alarm_cleared and not is_active",
            "time_cleared is not empty",
            "time_cleared between 1 and 9223372036854775807",
        ),
        ("is_raised", "is_active", "time_cleared is empty"),
    ),
    Vector(
        "alarm-cleared-waiting",
        "Cleared, not confirmed yet: still active.",
        AlarmCleared(
            target="plc1",
            event_class=CLASS,
            event_id=8,
            severity=Severity.WARNING,
            time_ns=T0 + S,
            confirmation_state=C.WAIT_FOR_CONFIRMATION,
            time_raised_ns=T0,
            time_cleared_ns=T0 + S,
        ),
        ("is_active and not is_raised", "is_wait_for_confirmation", "severity = warning"),
        ("is_raised", "not is_active"),
    ),
    Vector(
        "alarm-cleared-with-reset",
        "Cleared with reset of the confirmation: one event, nobody need confirm any more.",
        AlarmCleared(
            target="plc1",
            event_class=CLASS,
            event_id=8,
            severity=Severity.WARNING,
            time_ns=T0 + S,
            confirmation_state=C.RESET,
            time_raised_ns=T0,
            time_cleared_ns=T0 + S,
        ),
        ("confirmation_state = reset and not is_active",),
        ("confirmation_state = confirmed", "is_wait_for_confirmation"),
    ),
    Vector(
        "alarm-disposed",
        "The alarm is gone while it was raised and waiting: cleared by that, and nothing is to be confirmed.",
        AlarmDisposed(
            target="plc1",
            event_class=CLASS,
            event_id=9,
            severity=Severity.CRITICAL,
            time_ns=T0 + 2 * S,
            confirmation_state=C.NOT_REQUIRED,
            time_raised_ns=T0,
            time_cleared_ns=T0 + 2 * S,
        ),
        ("kind = alarm_disposed", "confirmation_state = not_required", "is_alarm and not is_active"),
        ("is_active", "kind in (alarm_raised, alarm_cleared)"),
    ),
    Vector(
        "device",
        "An alarm of an EtherCAT device, without confirmation.",
        AlarmRaised(
            target="192.168.1.20.1.1",
            event_class=OTHER,
            event_id=1,
            severity=Severity.ERROR,
            time_ns=T0,
            raised=True,
            time_raised_ns=T0,
            vendor_id=2,
            product_code=72100946,
            revision_no=0,
        ),
        (
            "is_ethercat_device",
            "vendor_id = 2 and product_code = 0x44C2C52 and revision_no = 0",
            "confirmation_state = not_supported",
        ),
        ("vendor_id is empty", "revision_no is empty", "product_code > 0x44C2C52"),
    ),
    Vector(
        "replayed",
        "Sent again by a replay: new numbers, and in origin where it was recorded.",
        AlarmRaised(
            target="plc1",
            event_class=CLASS,
            event_id=7,
            severity=Severity.ERROR,
            session="77aa77aa77aa77aa",
            seq=1,
            key_seq=1,
            time_ns=T0,
            raised=True,
            time_raised_ns=T0,
            origin=Origin("live", "5f1c2a90", 41, 3),
        ),
        ("is_raised", "confirmation_state = not_supported"),
        ("is_message", "is_wait_for_confirmation"),
    ),
)


def _text(content: object) -> str:
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


def vector(row: Vector) -> dict[str, object]:
    """What the file of a vector holds."""
    element = codec.encode(row.event)
    filters = [(text, True) for text in row.taken_by] + [(text, False) for text in row.left_by]
    return {
        "name": row.name,
        "about": row.about,
        "wire": codec.WIRE,
        "event": json.loads(element),
        "key": keys.event_key(keys.LIVE, row.event),
        "json": element.decode(),
        "msgpack": codec.encode(row.event, codec.MSGPACK).hex(),
        "filters": [{"text": text, "matches": matches} for text, matches in filters],
    }


def access_rules() -> dict[str, object]:
    """A part of a Zenoh configuration that allows the events and verbs of plc1 in live, and nothing else."""
    rules = keys.acl_rules(keys.LIVE, "plc1")
    return {
        "access_control": {
            "enabled": True,
            "default_permission": "deny",
            "rules": rules,
            "subjects": [{"id": "everybody"}],
            "policies": [{"rules": [rule["id"] for rule in rules], "subjects": ["everybody"]}],
        }
    }


def files() -> dict[str, str]:
    """Every generated file: its path below schemas/ and its text."""
    made: dict[str, object] = {"event.schema.json": codec.schema(), "acl.example.json": access_rules()}
    for name, (payload, where) in TYPES.items():
        schema = msgspec.json.schema(payload)
        made[f"{name}.schema.json"] = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": f"tcbridge.{payload.__name__}",
            "description": where,
            **schema,
        }
    for row in VECTORS:
        made[f"vectors/{row.name}.json"] = vector(row)
    return {path: _text(content) for path, content in made.items()}


def main() -> None:
    """Write what changed and remove what is no longer made."""
    wanted = files()
    for path in [*HERE.glob("*.json"), *HERE.glob("vectors/*.json")]:
        if str(path.relative_to(HERE)) not in wanted:
            path.unlink()
            print(f"removed {path.relative_to(HERE)}")
    for name, text in wanted.items():
        path = HERE / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
            print(f"wrote {name}")


if __name__ == "__main__":
    main()
