"""Keys: where an event is on the bus, which keys a selection takes, and what hides from wildcards."""

import pytest

from bridge.core.events import Severity
from bridge.core.keys import (
    LIVE,
    VERBS,
    EventKey,
    KeyFormatError,
    Selection,
    acl_rules,
    escape,
    event_key,
    expression,
    includes,
    parse_event_key,
    parse_verb_key,
    unescape,
    verb_key,
)
from bridge.testing.builders import (
    EVENT_CLASS,
    OTHER_CLASS,
    alarm_cleared,
    alarm_confirmed,
    alarm_disposed,
    alarm_raised,
    message_sent,
)

KEY = f"tc3/1/live/plc1/event/{EVENT_CLASS}/alarm/error"


def test_the_key_says_realm_target_class_kind_and_severity() -> None:
    """Identity is in the key: who wants errors of one class is sent nothing else."""
    assert event_key(LIVE, alarm_raised(severity=Severity.ERROR)) == KEY
    assert event_key("replay-0011aabb", message_sent(target="plc2", event_class=OTHER_CLASS)) == (
        f"tc3/1/replay-0011aabb/plc2/event/{OTHER_CLASS}/message/info"
    )


def test_all_transitions_of_an_alarm_share_a_key() -> None:
    """Raise, clear, confirm and dispose keep their order, because they are on one key."""
    kinds = (alarm_raised, alarm_cleared, alarm_confirmed, alarm_disposed)
    assert {event_key(LIVE, kind(severity=Severity.ERROR)) for kind in kinds} == {KEY}


def test_the_class_has_one_spelling_in_the_key() -> None:
    """Braces and upper case would be other keys; they are written in lower case without braces."""
    assert event_key(LIVE, alarm_raised(severity=Severity.ERROR, event_class=f"{{{EVENT_CLASS.upper()}}}")) == KEY


def test_a_key_is_taken_apart() -> None:
    """parse_event_key() is the inverse of event_key(), for every severity and both types."""
    assert parse_event_key(KEY) == EventKey("live", "plc1", EVENT_CLASS, True, Severity.ERROR)
    for severity in Severity:
        for event in (message_sent(severity=severity, target="ä b"), alarm_raised(severity=severity, target="ä b")):
            parsed = parse_event_key(event_key("r/1", event))
            assert parsed == EventKey("r/1", "ä b", EVENT_CLASS, event.is_alarm, severity)


@pytest.mark.parametrize(
    ("key", "expected"),
    [
        ("", "tc3/1/<realm>/<target>/event/<class>/<message|alarm>/<severity>"),
        (KEY + "/x", "tc3/1/<realm>"),
        (KEY.replace("tc3/1", "tc3/2"), "tc3/1/<realm>"),
        (KEY.replace("/event/", "/events/"), "tc3/1/<realm>"),
        (KEY.replace("/alarm/", "/Alarm/"), "message or alarm before the severity"),
        (KEY.replace("/error", "/fatal"), "one of verbose, info, warning, error, critical at the end"),
        (KEY.replace(EVENT_CLASS, EVENT_CLASS.upper()), "a GUID in lower case"),
        (KEY.replace(EVENT_CLASS, "{" + EVENT_CLASS + "}"), "a GUID in lower case"),
        (KEY.replace(EVENT_CLASS, "Motor"), "a GUID in lower case"),
        (KEY.replace("/plc1/", "/plc 1/"), "a name escaped as %XX"),
        (KEY.replace("/plc1/", "/%70lc1/"), "a name escaped as %XX"),
        (KEY.replace("/plc1/", "/plc%c3%a4/"), "a name escaped as %XX"),
        (KEY.replace("/plc1/", "/%FF/"), "a name escaped as %XX"),
        (KEY.replace("/live/", "//"), "a name escaped as %XX"),
    ],
)
def test_a_foreign_key_is_refused_with_what_was_expected(key: str, expected: str) -> None:
    """Another prefix, other words, another spelling of the class, and names escaped otherwise than needed."""
    with pytest.raises(KeyFormatError) as caught:
        parse_event_key(key)
    assert caught.value.expected.startswith(expected)
    assert caught.value.expected in str(caught.value)


NAMES = [
    ("plc1", "plc1"),
    ("Cell-3_a.b~c", "Cell-3_a.b~c"),
    ("a/b", "a%2Fb"),
    ("a b", "a%20b"),
    ("*", "%2A"),
    ("**", "%2A%2A"),
    ("$*", "%24%2A"),
    ("?x#y", "%3Fx%23y"),
    ("@state", "%40state"),
    ("%41", "%2541"),
    ("Öl", "%C3%96l"),
    ("🙂", "%F0%9F%99%82"),
    ("\0\n", "%00%0A"),
    ("192.168.0.1.1.1", "192.168.0.1.1.1"),
]


@pytest.mark.parametrize(("name", "chunk"), NAMES)
def test_names_from_outside_are_escaped(name: str, chunk: str) -> None:
    """What Zenoh forbids or hides is written as %XX of its UTF-8 bytes; letters, digits, `_`, `.`, `~`, `-` stay."""
    assert escape(name) == chunk
    assert unescape(chunk) == name


@pytest.mark.parametrize("name", ["", "\ud800"])
def test_a_name_must_be_text_and_not_empty(name: str) -> None:
    """Zenoh has no empty chunks, and a lone surrogate has no UTF-8 bytes."""
    with pytest.raises(KeyFormatError, match="expected"):
        escape(name)
    with pytest.raises(KeyFormatError):
        event_key(name, message_sent())


def test_an_event_may_disagree_with_its_key() -> None:
    """The first field that differs is named; who decodes a payload rejects it then."""
    key = parse_event_key(KEY)
    good = alarm_raised(severity=Severity.ERROR)
    assert key.disagreement(good) == ""
    assert key.disagreement(alarm_raised(severity=Severity.ERROR, event_class=OTHER_CLASS)) == "event_class"
    assert key.disagreement(alarm_raised(severity=Severity.INFO)) == "severity"
    assert key.disagreement(message_sent(severity=Severity.ERROR)) == "kind"
    assert key.disagreement(alarm_raised(severity=Severity.ERROR, target="plc2")) == "target"


SELECTIONS = [
    (Selection(), "tc3/1/live/*/event/*/*/*"),
    (Selection(target="plc1"), "tc3/1/live/plc1/event/*/*/*"),
    (Selection(target="*"), "tc3/1/live/%2A/event/*/*/*"),
    (Selection(event_class=EVENT_CLASS), f"tc3/1/live/*/event/{EVENT_CLASS}/*/*"),
    (Selection(is_alarm=False), "tc3/1/live/*/event/*/message/*"),
    (Selection(severity=Severity.VERBOSE), "tc3/1/live/*/event/*/*/verbose"),
    (Selection("plc1", EVENT_CLASS, True, Severity.ERROR), KEY),
]


@pytest.mark.parametrize(("selection", "text"), SELECTIONS)
def test_a_selection_is_a_key_expression(selection: Selection, text: str) -> None:
    """None takes every value of its chunk, False and VERBOSE are values; a target named `*` is that target only."""
    assert expression(LIVE, selection) == text


@pytest.mark.parametrize(
    ("selection", "taken"),
    [
        (Selection(), True),
        (Selection(target="plc1"), True),
        (Selection(target="plc2"), False),
        (Selection(event_class=EVENT_CLASS), True),
        (Selection(event_class=OTHER_CLASS), False),
        (Selection(is_alarm=True), True),
        (Selection(is_alarm=False), False),
        (Selection(severity=Severity.ERROR), True),
        (Selection(severity=Severity.VERBOSE), False),
        (Selection("plc1", EVENT_CLASS, True, Severity.ERROR), True),
        (Selection("plc1", EVENT_CLASS, True, Severity.CRITICAL), False),
    ],
)
def test_a_selection_takes_an_event_or_its_key(selection: Selection, taken: bool) -> None:
    """Every chunk that is not None must agree; the event itself and its parsed key are asked alike."""
    assert includes(selection, parse_event_key(KEY)) is taken
    assert includes(selection, alarm_raised(severity=Severity.ERROR)) is taken


def test_an_empty_target_selects_nothing() -> None:
    """None is every target; "" is a name that no target can have, and no key expression."""
    assert not includes(Selection(target=""), parse_event_key(KEY))
    with pytest.raises(KeyFormatError):
        expression(LIVE, Selection(target=""))


def test_a_selected_class_has_one_spelling() -> None:
    """However the GUID is written, expression and includes() mean the same class; a name is refused at once."""
    selection = Selection(event_class=f"{{{EVENT_CLASS.upper()}}}")
    assert selection == Selection(event_class=EVENT_CLASS)
    assert includes(selection, parse_event_key(KEY))
    with pytest.raises(ValueError, match="'Motor' is no GUID"):
        Selection(event_class="Motor")


def test_questions_commands_and_tokens_have_hidden_keys() -> None:
    """A chunk that begins with @ is not matched by a wildcard; None stands for every target or part."""
    assert verb_key(LIVE, "plc1", "@state") == "tc3/1/live/plc1/@state"
    assert verb_key(LIVE, "a/b", "@do", "raise") == "tc3/1/live/a%2Fb/@do/raise"
    assert verb_key(LIVE, None, "@alive", "logger", None) == "tc3/1/live/*/@alive/logger/*"


def test_a_hidden_key_is_taken_apart() -> None:
    """realm, target, verb and parts come back unescaped."""
    assert parse_verb_key(verb_key("r/1", "a b", "@alive", "logger", "x@y")) == ("r/1", "a b", "@alive", ("logger", "x@y"))
    assert parse_verb_key(verb_key(LIVE, "plc1", "@state")) == (LIVE, "plc1", "@state", ())


@pytest.mark.parametrize("key", ["tc3/1/live/plc1", "tc3/1/live/plc1/@no", "tc3/2/live/plc1/@state", KEY, "tc3/1/live//@state"])
def test_another_key_is_no_hidden_one(key: str) -> None:
    """An event's key, an unknown verb, another prefix."""
    with pytest.raises(KeyFormatError):
        parse_verb_key(key)


def test_an_unknown_verb_cannot_be_asked() -> None:
    """The message lists those there are."""
    with pytest.raises(
        ValueError,
        match="'@stat' is no verb; expected one of @state, @log, @classes, @do, @control, @objects, @sent, @beat, @alive",
    ):
        verb_key(LIVE, "plc1", "@stat")


def test_access_rules_cover_events_and_every_verb() -> None:
    """One rule for the events of a target and one for each verb, each with the messages it needs and an id of its own."""
    rules = {rule["id"]: rule for rule in acl_rules(LIVE, "a/b")}
    assert list(rules) == ["events", *(verb.removeprefix("@") for verb in VERBS)]
    assert rules["events"]["key_exprs"] == ["tc3/1/live/a%2Fb/event/**"]
    assert rules["events"]["messages"] == ["put", "declare_subscriber"]
    assert rules["state"]["key_exprs"] == ["tc3/1/live/a%2Fb/@state"]
    assert rules["state"]["messages"] == ["query", "reply", "declare_queryable"]
    assert rules["do"]["key_exprs"] == ["tc3/1/live/a%2Fb/@do/**"]
    assert rules["alive"]["messages"] == ["liveliness_token", "liveliness_query", "declare_liveliness_subscriber"]
    assert all(rule["permission"] == "allow" and rule["flows"] == ["ingress", "egress"] for rule in rules.values())
