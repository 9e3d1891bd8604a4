"""Where things are on the bus: one table of chunks builds, parses and selects keys.

    tc3/1/{realm}/{target}/event/{event_class}/{message|alarm}/{severity}      events
    tc3/1/{realm}/{target}/@{question}[/...]                                   questions, commands, beats, liveliness

Rule 1: identity in the key, detail in the payload. All transitions of one alarm life share a key.
Rule 2: names from outside are escaped here and nowhere else. Zenoh forbids empty chunks and `* $ ? #`, hides a chunk that
starts with `@` from wildcards, and compares bytes: so everything but ASCII letters, digits, `_`, `.`, `~` and a `-` is
written as %XX of its UTF-8 bytes, and so is a leading `@`.
Rule 3: `**` does not match a chunk that starts with `@`, so a wildcard for events never hits a command.
"""

import re
from functools import lru_cache
from typing import Final, NamedTuple
from urllib.parse import quote, unquote

import msgspec

from bridge.core.arguments import guid
from bridge.core.events import Event, Severity

PREFIX: Final = "tc3/1"
LIVE: Final = "live"
EVENT: Final = "event"
_TYPES: Final = {True: "alarm", False: "message"}
_TYPE_VALUES: Final = {text: value for value, text in _TYPES.items()}
_SEVERITIES: Final = {severity: severity.name.lower() for severity in Severity}
_SEVERITY_VALUES: Final = {text: severity for severity, text in _SEVERITIES.items()}
_ESCAPE: Final = re.compile(r"%[0-9A-F]{2}")


class KeyFormatError(ValueError):
    """A key or a name that is not of this key space; says which chunk and what was expected."""

    def __init__(self, key: str, expected: str) -> None:
        self.key, self.expected = key, expected
        super().__init__(f"{key!r}: expected {expected}")


def escape(name: str) -> str:
    """A name as one chunk. KeyFormatError for an empty name or a lone surrogate."""
    if not name:
        raise KeyFormatError(name, "a name that is not empty")
    try:
        return quote(name, safe="")
    except UnicodeEncodeError:
        raise KeyFormatError(name, "text without lone surrogates") from None


def unescape(chunk: str) -> str:
    """The name that escape() wrote. KeyFormatError when escape() would not have written it so."""
    try:
        name = unquote(chunk, errors="strict")
        if name and escape(name) == chunk:
            return name
    except UnicodeDecodeError:
        pass
    raise KeyFormatError(chunk, "a name escaped as %XX")


class EventKey(msgspec.Struct, frozen=True):
    """What an event's key says."""

    realm: str
    target: str
    event_class: str
    is_alarm: bool
    severity: Severity

    def disagreement(self, event: Event) -> str:
        """The field in which the event differs from its key, or "" when it agrees."""
        if event.event_class != self.event_class:
            return "event_class"
        if event.severity is not self.severity:
            return "severity"
        if event.is_alarm is not self.is_alarm:
            return "kind"
        return "" if event.target == self.target else "target"


class Selection(msgspec.Struct, frozen=True):
    """A set of event keys: None takes every value of that chunk. ValueError for a class that is no GUID."""

    target: str | None = None
    event_class: str | None = None
    is_alarm: bool | None = None
    severity: Severity | None = None

    def __post_init__(self) -> None:
        if self.event_class is not None:
            msgspec.structs.force_setattr(self, "event_class", guid(self.event_class))


@lru_cache(maxsize=65536)
def _event_key(realm: str, target: str, event_class: str, is_alarm: bool, severity: Severity) -> str:
    return "/".join(
        (
            PREFIX,
            escape(realm),
            escape(target),
            EVENT,
            guid(event_class),
            _TYPES[is_alarm],
            _SEVERITIES[severity],
        )
    )


def event_key(realm: str, event: Event) -> str:
    """The key that carries the event. KeyFormatError or ValueError when a name or the class cannot be a chunk."""
    return _event_key(realm, event.target, event.event_class, event.is_alarm, event.severity)


@lru_cache(maxsize=65536)
def parse_event_key(key: str) -> EventKey:
    """Take an event's key apart. KeyFormatError names what was expected."""
    chunks = key.split("/")
    if len(chunks) != 8 or chunks[:2] != PREFIX.split("/") or chunks[4] != EVENT:
        raise KeyFormatError(key, f"{PREFIX}/<realm>/<target>/{EVENT}/<class>/<message|alarm>/<severity>")
    if chunks[6] not in _TYPE_VALUES:
        raise KeyFormatError(key, "message or alarm before the severity")
    if chunks[7] not in _SEVERITY_VALUES:
        raise KeyFormatError(key, f"one of {', '.join(_SEVERITY_VALUES)} at the end")
    try:
        event_class = guid(chunks[5])
    except ValueError:
        event_class = ""
    if event_class != chunks[5]:
        raise KeyFormatError(key, "a GUID in lower case with hyphens and no braces after event/")
    return EventKey(unescape(chunks[2]), unescape(chunks[3]), event_class, _TYPE_VALUES[chunks[6]], _SEVERITY_VALUES[chunks[7]])


def expression(realm: str, selection: Selection) -> str:
    """The key expression that matches exactly the selected event keys of the realm."""
    return "/".join(
        (
            PREFIX,
            escape(realm),
            "*" if selection.target is None else escape(selection.target),
            EVENT,
            "*" if selection.event_class is None else selection.event_class,
            "*" if selection.is_alarm is None else _TYPES[selection.is_alarm],
            "*" if selection.severity is None else _SEVERITIES[selection.severity],
        )
    )


def includes(selection: Selection, key: EventKey | Event) -> bool:
    """Whether the selection takes events of this key."""
    return (
        selection.target in (None, key.target)
        and selection.event_class in (None, key.event_class)
        and selection.is_alarm in (None, key.is_alarm)
        and selection.severity in (None, key.severity)
    )


class Verb(NamedTuple):
    """One row of VERBS: what a hidden key is for and what reaching it needs in an access-control rule."""

    chunk: str
    parameter: str
    messages: tuple[str, ...]
    help: str


_ASK: Final = ("query", "reply", "declare_queryable")
_TELL: Final = ("put", "declare_subscriber")
_LIVE: Final = ("liveliness_token", "liveliness_query", "declare_liveliness_subscriber")
VERBS: Final = {
    verb.chunk: verb
    for verb in (
        Verb("@state", "", _ASK, "the alarms of a logger, with session and seq"),
        Verb("@log", "", _ASK, "stored events of a logger"),
        Verb("@classes", "", _ASK, "event classes a logger offers"),
        Verb("@do", "command", _ASK, "commands to a logger"),
        Verb("@control", "command", _ASK, "commands to a recorder or a player, whose name stands for the target"),
        Verb("@objects", "access", _ASK, "calls to objects (modules), by what they need: read, set, call, state"),
        Verb("@sent", "session", _ASK, "events a publisher still holds, for those who missed them"),
        Verb("@beat", "session", _TELL, "a publisher's numbers, each second"),
        Verb("@alive", "role", _LIVE, "who is there: role and session"),
    )
}


def verb_key(realm: str | None, target: str | None, verb: str, *parts: str | None) -> str:
    """The hidden key of a question, command, beat or token; None stands for every realm, target or part.

    ValueError for a verb that is not in VERBS.
    """
    if verb not in VERBS:
        raise ValueError(f"{verb!r} is no verb; expected one of {', '.join(VERBS)}")
    realm_chunk, target_chunk, *rest = ("*" if name is None else escape(name) for name in (realm, target, *parts))
    return "/".join([PREFIX, realm_chunk, target_chunk, verb, *rest])


def parse_verb_key(key: str) -> tuple[str, str, str, tuple[str, ...]]:
    """(realm, target, verb, parts) of a hidden key; KeyFormatError else."""
    chunks = key.split("/")
    if len(chunks) < 5 or chunks[:2] != PREFIX.split("/") or chunks[4] not in VERBS:
        raise KeyFormatError(key, f"{PREFIX}/<realm>/<target>/<{'|'.join(VERBS)}>")
    return unescape(chunks[2]), unescape(chunks[3]), chunks[4], tuple(unescape(chunk) for chunk in chunks[5:])


def acl_rules(realm: str, target: str) -> list[dict[str, object]]:
    """Zenoh access-control rules (JSON-ready) for events and each verb of a target: what to allow when the default is deny."""
    rules: list[dict[str, object]] = [
        {
            "id": "events",
            "permission": "allow",
            "messages": list(_TELL),
            "flows": ["ingress", "egress"],
            "key_exprs": [f"{PREFIX}/{escape(realm)}/{escape(target)}/{EVENT}/**"],
        }
    ]
    for verb in VERBS.values():
        key = verb_key(realm, target, verb.chunk) + ("/**" if verb.parameter else "")
        rules.append(
            {
                "id": verb.chunk[1:],
                "permission": "allow",
                "messages": list(verb.messages),
                "flows": ["ingress", "egress"],
                "key_exprs": [key],
            }
        )
    return rules
