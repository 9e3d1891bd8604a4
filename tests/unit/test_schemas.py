"""What we publish for other languages is what the code does: schemas, golden vectors, access rules."""

import json
from pathlib import Path
from typing import TypedDict

import msgspec
import pytest
import zenoh
from jsonschema import Draft202012Validator

from bridge.core import codec, keys
from bridge.core.alarms import AlarmKey, Clear, Confirm, Create, Dispose, Raise, fold
from bridge.core.arguments import Argument, ArgumentType
from bridge.core.catalog import EventClass, EventEntry
from bridge.core.class_offer import ClassesPart, ClassesQuestion
from bridge.core.control import ControlAnswer, ControlQuestion, Seek, Status
from bridge.core.events import KIND_NAMES, AlarmRaised, ConfirmationState, MessageSent, Severity
from bridge.core.filters.ast import And as AndExpr
from bridge.core.filters.ast import Between, Compare, Expr, Flag, In, IsEmpty, JsonPointer, Like, Not
from bridge.core.filters.ast import Or as OrExpr
from bridge.core.filters.fields import FIELDS, FLAGS
from bridge.core.filters.predicate import compile_filter
from bridge.core.filters.text import parse
from bridge.core.questions import (
    ClearLogAnswer,
    ClearLogQuestion,
    CommandAnswer,
    CommandQuestion,
    LogPart,
    LogQuestion,
    StatePart,
    Stored,
)
from bridge.core.sequence import Beat, Missing
from bridge.testing.builders import EVENT_CLASS, alarm_raised, message_sent
from schemas import generate

ROOT = Path(__file__).parents[2]
HERE = ROOT / "schemas"
COMMITTED = {str(path.relative_to(HERE)): path for path in [*HERE.glob("*.json"), *HERE.glob("vectors/*.json")]}


class FilterCase(TypedDict):
    """A filter's text and whether it takes the event."""

    text: str
    matches: bool


class Vector(TypedDict):
    """A file of schemas/vectors."""

    name: str
    about: str
    wire: int
    event: dict[str, object]
    key: str
    json: str
    msgpack: str
    filters: list[FilterCase]


def read(path: Path) -> Vector:
    """A vector, checked to have exactly these parts."""
    return msgspec.json.decode(path.read_bytes(), type=Vector)


VECTORS = [read(path) for name, path in sorted(COMMITTED.items()) if name.startswith("vectors/")]
SCHEMA = json.loads((HERE / "event.schema.json").read_text(encoding="utf-8"))
vectors = pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: vector["name"])


def test_what_is_committed_is_what_the_code_makes() -> None:
    """`make schemas` would change nothing. A difference is a change of the wire: meant, or a mistake."""
    made = generate.files()
    assert sorted(COMMITTED) == sorted(made)
    for name, text in made.items():
        assert COMMITTED[name].read_text(encoding="utf-8") == text, f"{name} is not what the code makes; run make schemas"


def test_every_vector_has_its_name() -> None:
    """The file, the name and the wire format agree, and each says what it is about."""
    assert {f"vectors/{vector['name']}.json" for vector in VECTORS} == {n for n in COMMITTED if n.startswith("vectors/")}
    assert all(vector["about"] and vector["wire"] == codec.WIRE for vector in VECTORS)


@vectors
def test_a_vector_decodes_and_encodes_to_its_bytes(vector: Vector) -> None:
    """JSON and msgpack hold the same event, under its key, and are written exactly so; the readable form is the JSON."""
    key = keys.parse_event_key(vector["key"])
    for encoding, element in ((codec.JSON, vector["json"].encode()), (codec.MSGPACK, bytes.fromhex(vector["msgpack"]))):
        event = codec.decode_one(element, encoding)
        assert codec.encode(event, encoding) == element
        assert codec.decode(element, encoding, key) == codec.Decoded([event], [])
        assert codec.split(codec.join([element, element], encoding), encoding) == [element, element]
        assert keys.event_key(keys.LIVE, event) == vector["key"]
        assert codec.encode(event) == vector["json"].encode()
    assert json.loads(vector["json"]) == vector["event"] == msgspec.msgpack.decode(bytes.fromhex(vector["msgpack"]))


@vectors
def test_a_vectors_filters_take_it_or_leave_it(vector: Vector) -> None:
    """As the file says; each vector has a filter that takes it and one that does not."""
    event = codec.decode_one(vector["json"].encode())
    found = [(case["text"], compile_filter(parse(case["text"]))(event)) for case in vector["filters"]]
    assert found == [(case["text"], case["matches"]) for case in vector["filters"]]
    assert {matches for _, matches in found} == {True, False}


@vectors
def test_a_vector_fits_the_schema(vector: Vector) -> None:
    """As a reader in another language would check it."""
    assert [error.message for error in Draft202012Validator(SCHEMA).iter_errors(vector["event"])] == []


def parts(expr: Expr) -> list[Expr]:
    """The nodes of a filter, itself first."""
    match expr:
        case AndExpr(items) | OrExpr(items):
            return [expr, *(part for item in items for part in parts(item))]
        case Not(item):
            return [expr, *parts(item)]
    return [expr]


def test_the_vectors_cover_the_wire() -> None:
    """Every kind, severity, confirmation state, argument type and one unknown, every field of an event; absent and empty."""
    events = [codec.decode_one(vector["json"].encode()) for vector in VECTORS]
    assert {event.kind for event in events} == set(KIND_NAMES)
    assert {event.severity for event in events} == set(Severity)
    assert {event.confirmation_state for event in events} == set(ConfirmationState)
    types = {argument.type for event in events for argument in event.arguments}
    assert types > set(ArgumentType)
    assert {name for vector in VECTORS for name in vector["event"]} == {"kind", *MessageSent.__struct_fields__}
    sources = {(event.source_id, event.source_name, event.source_guid) for event in events}
    assert {(None, None, None), (0, "", "00000000-0000-0000-0000-000000000000")} < sources


def test_the_vectors_cover_the_filters() -> None:
    """Every field an event can be asked for, every flag, JSON pointers, and every kind of condition."""
    nodes = [node for vector in VECTORS for case in vector["filters"] for node in parts(parse(case["text"]))]
    assert {type(node) for node in nodes} >= {AndExpr, OrExpr, Not, Compare, In, Between, Like, IsEmpty, Flag}
    operands = {node.field for node in nodes if isinstance(node, Compare | In | Between | Like | IsEmpty)}
    assert {name for name, field in FIELDS.items() if not field.log_only} <= operands
    assert any(isinstance(operand, JsonPointer) for operand in operands)
    assert {node.name for node in nodes if isinstance(node, Flag)} == set(FLAGS)


# The schema of an event, as Foxglove reads it.


def plain(schema: dict[str, object], place: str = "$") -> list[str]:
    """The places of a schema that have no single plain type, or refer elsewhere."""
    kind = schema.get("type")
    found = [] if isinstance(kind, str) and not {"$ref", "anyOf", "allOf", "$defs"} & set(schema) else [place]
    properties, items = schema.get("properties", {}), schema.get("items")
    assert isinstance(properties, dict)
    for name, inner in properties.items():
        found += plain(inner, f"{place}.{name}")
    return found + (plain(items, f"{place}[]") if isinstance(items, dict) else [])


def test_an_events_schema_is_plain() -> None:
    """The root is an object, every property has one plain type, nothing refers elsewhere: readers without $ref can use it."""
    assert SCHEMA["type"] == "object"
    assert plain(SCHEMA) == []
    assert set(SCHEMA["properties"]) == {"kind", *MessageSent.__struct_fields__}
    assert plain({"type": "object", "properties": {"a": {"anyOf": []}, "b": {"type": ["string", "null"]}}}) == ["$.a", "$.b"]


def test_the_schema_says_what_must_be_there() -> None:
    """The fields without a default, and the kind."""
    assert SCHEMA["required"] == ["kind", "target", "event_class", "event_id", "severity"]
    assert SCHEMA["properties"]["kind"]["enum"] == list(KIND_NAMES)
    assert [row["const"] for row in SCHEMA["properties"]["severity"]["oneOf"]] == [0, 1, 2, 3, 4]
    assert [row["title"] for row in SCHEMA["properties"]["confirmation_state"]["oneOf"]] == [c.name for c in ConfirmationState]


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("kind", "message"),
        ("target", None),
        ("event_id", 2**32),
        ("event_id", -1),
        ("event_id", "1"),
        ("severity", 5),
        ("confirmation_state", 5),
        ("raised", 1),
        ("time_ns", 2**63),
        ("arguments", [{"type": 4}]),
        ("arguments", [{"type": 65536, "value": ""}]),
        ("arguments", {}),
        ("origin", {"seq": -1}),
    ],
)
def test_schema_and_decoder_refuse_the_same(field: str, value: object) -> None:
    """What does not fit the schema is no event to the decoder either."""
    event = {**json.loads(codec.encode(alarm_raised())), field: value}
    assert not Draft202012Validator(SCHEMA).is_valid(event)
    with pytest.raises(codec.CodecError):
        codec.decode_one(json.dumps(event).encode())


@pytest.mark.parametrize("field", ["kind", "target", "event_class", "event_id", "severity"])
def test_schema_and_decoder_miss_the_same(field: str) -> None:
    """Each of the five is asked for by both."""
    event = json.loads(codec.encode(alarm_raised()))
    del event[field]
    assert not Draft202012Validator(SCHEMA).is_valid(event)
    with pytest.raises(codec.CodecError):
        codec.decode_one(json.dumps(event).encode())


# The other payloads, and the access rules.

KEY = AlarmKey("plc1", EVENT_CLASS, 7, 0, "")
ALARMS = tuple(fold([alarm_raised(session="s", seq=1, source_id=0, arguments=(Argument.of(1),))]).alarms.values())
PUMP = EventClass(
    EVENT_CLASS,
    "Pump",
    "Pumps",
    {1: EventEntry(1, "RanDry", Severity.ERROR, "Pump {0} ran dry")},
    {"Pumps": {1031: "Pumpen"}},
    hides=(EVENT_CLASS,),
)
SAMPLES: list[msgspec.Struct] = [
    Beat(target="plc1", session="s", role="logger", seq=9, keys={"k": 4}, final=True, unsent=2),
    Missing("s", "k", 1, 2, 3),
    StatePart(target="plc1", session="s", seq=1, parts=2, part=1, alarms=ALARMS),
    LogQuestion(filter="is_alarm", limit=1, offset=1, newest_first=False, missing=Missing("s", "k", 1, 2)),
    LogPart(session="s", last=False, events=(Stored(event=message_sent(), unique_id=1), Stored(event=alarm_raised()))),
    ClassesQuestion(guids=(EVENT_CLASS,), names=("Pump",)),
    ClassesPart(session="s", last=False, classes=(PUMP,), unknown=("Pumps",)),
    CommandQuestion(id="1", command=Create(key=KEY, severity=Severity.ERROR, with_confirmation=True)),
    CommandQuestion(id="1", command=Raise(key=KEY, arguments=(Argument.of(1),), json_attribute="")),
    CommandQuestion(id="1", command=Clear(key=KEY, reset_confirmation=True)),
    CommandQuestion(id="1", command=Confirm(key=KEY, operator="op")),
    CommandQuestion(id="1", command=Dispose(key=KEY, time_ns=1)),
    ClearLogQuestion(id="1", which=LogQuestion(limit=1, sort="id", take_last=True, view="occurrences", lang="de")),
    ClearLogAnswer(id="1", session="s", cleared=3),
    ControlQuestion(id="1", command=Seek("2026-11-22T08:00:00Z"), operator="op", comment="again"),
    ControlQuestion(id="2", command=Status()),
    ControlAnswer(id="1", session="s", status={"state": "paused", "events": 3, "rate": 0.5, "loop": True}, takes=("status",)),
    CommandAnswer(id="1", session="s", result=0xB7, alarm=ALARMS[0], created=True),
]


@pytest.mark.parametrize("name", generate.TYPES)
def test_other_payloads_fit_their_schemas(name: str) -> None:
    """Each schema is sound, takes what we send and refuses an empty object."""
    schema = json.loads((HERE / f"{name}.schema.json").read_text(encoding="utf-8"))
    Draft202012Validator.check_schema(schema)
    validator = Draft202012Validator(schema)
    samples = [sample for sample in SAMPLES if type(sample) is generate.TYPES[name][0]]
    assert samples
    for sample in samples:
        assert [error.message for error in validator.iter_errors(json.loads(msgspec.json.encode(sample)))] == []
    assert validator.is_valid({}) == (name in ("log-question", "classes-question"))
    assert not validator.is_valid([])


def test_zenoh_takes_the_access_rules() -> None:
    """The example is a part of a configuration that Zenoh itself reads; the rules are those of keys.py."""
    text = (HERE / "acl.example.json").read_text(encoding="utf-8")
    config = zenoh.Config.from_json5(text)
    assert json.loads(config.get_json("access_control"))["default_permission"] == "deny"
    assert json.loads(text)["access_control"]["rules"] == keys.acl_rules("live", "plc1")


def test_the_pages_tell_where_schemas_and_vectors_are() -> None:
    """docs/wire.md and schemas/README.md name every schema; the page's example is the vector alarm-raised."""
    wire = (ROOT / "docs" / "wire.md").read_text(encoding="utf-8")
    readme = (HERE / "README.md").read_text(encoding="utf-8")
    for name in COMMITTED:
        if not name.startswith("vectors/"):
            assert f"`{name}`" in readme
            assert f"`{name}`" in wire
    (example,) = [vector["json"] for vector in VECTORS if vector["name"] == "alarm-raised"]
    assert f"[{example}]" in wire
    assert isinstance(codec.decode_one(example.encode()), AlarmRaised)


def test_the_generator_writes_what_is_missing_and_removes_what_is_old(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A second run has nothing to do."""
    monkeypatch.setattr(generate, "HERE", tmp_path)
    (tmp_path / "vectors").mkdir()
    (tmp_path / "vectors" / "old.json").write_text("{}")
    generate.main()
    assert "removed vectors/old.json\n" in capsys.readouterr().out
    assert {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*.json")} == set(COMMITTED)
    generate.main()
    assert capsys.readouterr().out == ""
