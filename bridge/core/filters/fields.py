"""What a filter may ask about: one table of fields, read by every spelling, every back end, the help and the docs.

Rule 1: the name of a field is the attribute of the event, the column of the log and the word in the text. Aliases exist in
        the text only.
Rule 2: a value is canonical before it enters the tree: severities and states are plain ints, times are ns, GUIDs have one
        spelling. canonical() does it for values of Python, read() for words of the text.
Rule 3: an event class may be named instead of given by GUID. A name is no value yet: ast.resolve() replaces it.

Missing, per type: an integer or a GUID that is None, a source name that is None (but not ""), a time that is 0, a JSON
attribute that is "". Fields that are not optional are never missing, and so are not asked for `is empty`.

Source: manual 6.1.2.3 and the library's compiled interfaces (I_TcGuidCompare, I_TcUDIntCompare, ...), which offer no order
on texts, GUIDs and confirmation states.
"""

import re
from collections.abc import Callable, Sequence
from typing import Final, Literal, TypeAlias, get_args

import msgspec

from bridge.core.arguments import guid
from bridge.core.events import KIND_NAMES, ConfirmationState, Severity
from bridge.core.times import MAX_TIME_NS, parse_time, time_text

ValueType: TypeAlias = Literal["text", "guid", "class", "integer", "time", "severity", "confirmation", "kind"]
Comparison: TypeAlias = Literal["=", "!=", "<", "<=", ">", ">="]
Operator: TypeAlias = Literal["=", "!=", "<", "<=", ">", ">=", "like", "in", "between", "is empty"]
Value: TypeAlias = str | int | float
"""What a condition compares with. Floats occur with JSON pointers only."""
ClassResolver: TypeAlias = Callable[[str], Sequence[str]]
"""Every known GUID of a class name, hidden versions too; nothing when the name is unknown."""

COMPARISONS: Final = get_args(Comparison)
_EQUALITY: Final[frozenset[Operator]] = frozenset({"=", "!=", "in"})
_ORDER: Final[frozenset[Operator]] = _EQUALITY | {"<", "<=", ">", ">=", "between"}
OPERATORS: Final[dict[ValueType, frozenset[Operator]]] = {
    "text": _EQUALITY | {"like"},
    "guid": _EQUALITY,
    "class": _EQUALITY,
    "integer": _ORDER,
    "time": _ORDER,
    "severity": _ORDER,
    "confirmation": _EQUALITY,
    "kind": _EQUALITY,
}
"""Which operators a type has, besides `is empty` for optional fields."""
JSON_OPERATORS: Final[frozenset[Operator]] = _ORDER | {"like", "is empty"}

MAX_DIGITS: Final = 400
"""Digits of an integer that is compared exactly; far beyond every double, and below what Python refuses to read."""


class Field(msgspec.Struct, frozen=True):
    """One row. `lowest` is the smallest value that counts as set; `chunk` is its place in the key, if it has one."""

    name: str
    type: ValueType
    help: str
    aliases: tuple[str, ...] = ()
    optional: bool = False
    lowest: int = 0
    highest: int = 2**32 - 1
    chunk: bool = False
    log_only: bool = False

    @property
    def missing(self) -> Value | None:
        """The value that means "not set" for an optional field."""
        return 0 if self.type == "time" else "" if self.name == "json_attribute" else None

    @property
    def operators(self) -> frozenset[Operator]:
        """What this field may be asked."""
        return OPERATORS[self.type] | {"is empty"} if self.optional else OPERATORS[self.type]


def _time(name: str, help: str, *aliases: str) -> Field:
    return Field(name, "time", help, aliases, optional=True, lowest=1, highest=MAX_TIME_NS)


_ROWS: Final = (
    Field("target", "text", "name of the logger on the bus", chunk=True),
    Field("kind", "kind", f"one of {', '.join(KIND_NAMES)}"),
    Field("event_class", "class", "GUID or name of the event class", ("class", "event.class"), chunk=True),
    Field("event_id", "integer", "id of the event in its class", ("event.id",)),
    Field("severity", "severity", "verbose, info, warning, error, critical or 0 to 4", highest=4, chunk=True),
    Field("source_id", "integer", "object id of the source", ("source.id",), optional=True),
    Field("source_name", "text", "path of the source", ("source.name",), optional=True),
    Field("source_guid", "guid", "GUID of the source", ("source.guid",), optional=True),
    Field("json_attribute", "text", "the whole JSON attribute as text", optional=True),
    _time("time_ns", "the event's own time", "time"),
    _time("time_raised_ns", "when the alarm was raised", "time_raised", "time.raised"),
    _time("time_cleared_ns", "when the alarm was cleared", "time_cleared", "time.cleared"),
    _time("time_confirmed_ns", "when the alarm was confirmed", "time_confirmed", "time.confirmed"),
    Field("confirmation_state", "confirmation", "state of the confirmation, by name or 0 to 4", ("confirmation",), highest=4),
    Field("vendor_id", "integer", "vendor of the EtherCAT device", ("device.vendor_id",), optional=True),
    Field("product_code", "integer", "product code of the EtherCAT device", ("device.product_code",), optional=True),
    Field("revision_no", "integer", "revision of the EtherCAT device", ("device.revision_no",), optional=True),
    Field("unique_id", "integer", "number given by the logger that stored it; in the log only", log_only=True),
)
FIELDS: Final = {row.name: row for row in _ROWS}
NAMES: Final = {name: row for row in _ROWS for name in (row.name, *row.aliases)}
"""Fields by every word the text spelling takes."""

FLAGS: Final = {
    "is_message": "a message",
    "is_alarm": "a transition of an alarm",
    "is_raised": "an alarm that is raised",
    "is_active": "an alarm that is raised or waits for its confirmation",
    "is_wait_for_confirmation": "an alarm that waits for its confirmation",
    "is_ethercat_device": "an event of an EtherCAT device: it has a vendor id",
}
"""The tests without a value. Those of the alarm state are false for messages (I_TcAlarmFilterExpression)."""


def is_guid(text: str) -> bool:
    """Whether the text is a GUID in any spelling; what is none is the name of an event class."""
    try:
        guid(text)
    except ValueError:
        return False
    return True


def check_text(value: object, what: str) -> str:
    """The value, which must be a str without lone surrogates: TypeError or ValueError else."""
    if not isinstance(value, str):
        raise TypeError(f"{what} is compared with a text, not with {type(value).__name__}")
    try:
        value.encode()
    except UnicodeEncodeError:
        raise ValueError(f"{value!r} is no Unicode text: it has a lone surrogate") from None
    return value


def check_integer(value: object, what: str) -> int:
    """The value, which must be an int (no bool) of at most MAX_DIGITS digits: TypeError or ValueError else."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"{what} is compared with an integer, not with {type(value).__name__}")
    if abs(value) >= 10**MAX_DIGITS:
        raise ValueError(f"{what} is compared with at most {MAX_DIGITS} digits")
    return int(value)


def canonical(field: Field, value: object) -> str | int:
    """The value as the tree holds it. TypeError for a value of another type, ValueError for one that cannot be."""
    what = field.name
    match field.type:
        case "text":
            return check_text(value, what)
        case "guid":
            return guid(check_text(value, what))
        case "class":
            text = check_text(value, what)
            if not text:
                raise ValueError("an event class has a name or a GUID")
            return guid(text) if is_guid(text) else text
        case "integer" | "time":
            return check_integer(value, what)
        case "severity" | "confirmation":
            number = check_integer(value, what)
            if not 0 <= number <= field.highest:
                raise ValueError(f"{what} {number} is outside 0..{field.highest}")
            return number
        case "kind":
            if value not in KIND_NAMES:
                raise ValueError(f"{value!r} is no kind; expected {', '.join(KIND_NAMES)}")
            return value


def _plain(word: str) -> str:
    return word.replace("_", "").lower()


_WORDS: Final[dict[ValueType, dict[str, str | int]]] = {
    "severity": {_plain(severity.name): int(severity) for severity in Severity},
    "confirmation": {_plain(state.name): int(state) for state in ConfirmationState},
    "kind": {_plain(kind): kind for kind in KIND_NAMES},
}
WORDS: Final[dict[ValueType, tuple[str, ...]]] = {
    "severity": tuple(severity.name.lower() for severity in Severity),
    "confirmation": tuple(state.name.lower() for state in ConfirmationState),
    "kind": KIND_NAMES,
}
"""The names of enumerated values, as to_text() writes them. read() takes them in any case, with or without underscores."""
_INTEGER: Final = re.compile(r"[+-]?[0-9]+")
_HEX: Final = re.compile(r"0[xX][0-9a-fA-F]+")


def read_integer(word: str) -> int:
    """An integer, decimal or as 0x1F. ValueError when it is none or has more than MAX_DIGITS digits."""
    if len(word) <= MAX_DIGITS + 1 and _INTEGER.fullmatch(word):
        return int(word)
    if len(word) <= MAX_DIGITS // 2 and _HEX.fullmatch(word):
        return int(word, 16)
    raise ValueError(f"{word[:40]!r} is no integer of up to {MAX_DIGITS} digits")


def read(field: Field, word: str) -> str | int:
    """The canonical value of a word of the text (quotes removed). ValueError (TimeError for times) says what was expected."""
    match field.type:
        case "text" | "guid" | "class":
            return canonical(field, word)
        case "integer":
            return read_integer(word)
        case "time":
            return read_integer(word) if _INTEGER.fullmatch(word) else parse_time(word)
        case "severity" | "confirmation" | "kind":
            known = _WORDS[field.type].get(_plain(word))
            if known is not None:
                return known
            if field.type != "kind" and _INTEGER.fullmatch(word):
                return canonical(field, read_integer(word))
            raise ValueError(f"{word!r} is no {field.name}; expected {', '.join(WORDS[field.type])}")


def quoted(text: str) -> str:
    """The text in single quotes, a single quote in it doubled."""
    return "'" + text.replace("'", "''") + "'"


def show(field: Field, value: Value) -> str:
    """The canonical spelling of a canonical value: show() and read() are inverse."""
    if isinstance(value, str):
        return value if field.type == "kind" else quoted(value)
    if field.type in ("severity", "confirmation"):
        return WORDS[field.type][int(value)]
    if field.type == "time" and 0 < value <= MAX_TIME_NS:
        whole, _, fraction = time_text(int(value)).rstrip("Z").partition(".")
        fraction = fraction.rstrip("0")
        return f"'{whole}.{fraction}Z'" if fraction else f"'{whole}Z'"
    return str(value)
