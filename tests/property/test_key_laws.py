"""Laws of the keys, held against the real Zenoh: what we call a key, a match and hidden is what the bus does."""

import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.core.events import AnyEvent, Severity
from bridge.core.keys import (
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
from bridge.testing.builders import EVENT_CLASS, OTHER_CLASS, alarm_raised, message_sent

nasty = st.lists(
    st.sampled_from(["a", "A", "*", "**", "$*", "?", "#", "@", "/", "%", "%2F", ".", "~", "-", "_", " ", "\0", "ä", "🙂"])
)
names = st.one_of(st.text(st.characters(exclude_categories=["Cs"]), min_size=1), nasty.map("".join).filter(bool))
few_names = st.sampled_from(["a", "b", "*", "@a", "a/b", "live"])


@given(names)
def test_a_name_comes_back(name: str) -> None:
    """unescape(escape(name)) is the name, and the chunk is made of characters that Zenoh takes as they are."""
    chunk = escape(name)
    assert unescape(chunk) == name
    assert chunk.isascii()
    assert not set(chunk) & set("/*$?#@ ")
    assert str(zenoh.KeyExpr(chunk)) == str(zenoh.KeyExpr.autocanonize(chunk)) == chunk


@given(names, names)
def test_two_names_are_two_chunks(one: str, other: str) -> None:
    """Nothing is folded together: chunks are equal exactly when names are, and only then do they intersect."""
    assert (escape(one) == escape(other)) == (one == other)
    assert zenoh.KeyExpr(escape(one)).intersects(zenoh.KeyExpr(escape(other))) == (one == other)


@given(st.text(max_size=12) | nasty.map("".join))
def test_a_chunk_is_ours_or_refused(chunk: str) -> None:
    """What unescape() takes, escape() would have written; everything else is KeyFormatError."""
    try:
        name = unescape(chunk)
    except KeyFormatError:
        return
    assert escape(name) == chunk


events = st.builds(
    lambda target, event_class, severity, is_alarm: (alarm_raised if is_alarm else message_sent)(
        target=target, event_class=event_class, severity=severity
    ),
    few_names | names,
    st.sampled_from([EVENT_CLASS, OTHER_CLASS]),
    st.sampled_from(Severity),
    st.booleans(),
)


@given(few_names | names, events)
def test_an_event_key_is_a_zenoh_key_and_comes_back(realm: str, event: AnyEvent) -> None:
    """It is canonical, has no wildcard, and parses into what it was made of."""
    key = event_key(realm, event)
    assert str(zenoh.KeyExpr(key)) == key
    parsed = parse_event_key(key)
    assert parsed == EventKey(realm, event.target, event.event_class, event.is_alarm, event.severity)
    assert parsed.disagreement(event) == ""


@st.composite
def selections(draw: st.DrawFn) -> Selection:
    """A selection near the events above; often of their values, sometimes spelled otherwise."""
    return Selection(
        draw(st.none() | few_names),
        draw(st.sampled_from([None, EVENT_CLASS, OTHER_CLASS, EVENT_CLASS.upper(), f"{{{OTHER_CLASS}}}"])),
        draw(st.sampled_from([None, True, False])),
        draw(st.sampled_from([None, *Severity])),
    )


@settings(max_examples=1000)
@given(few_names, few_names, selections(), events)
def test_a_selection_takes_what_zenoh_would_deliver(realm: str, other: str, selection: Selection, event: AnyEvent) -> None:
    """includes() is the intersection of key expression and key, within a realm; between realms there is none."""
    wanted = zenoh.KeyExpr(expression(realm, selection))
    key = event_key(other, event)
    assert wanted.intersects(zenoh.KeyExpr(key)) == (includes(selection, event) and realm == other)
    assert includes(selection, parse_event_key(key)) == includes(selection, event)


@given(few_names, selections(), selections())
def test_a_wider_selection_includes_a_narrower_one(realm: str, one: Selection, other: Selection) -> None:
    """Zenoh's inclusion of key expressions is that of selections, field by field."""
    pairs = zip(
        (one.target, one.event_class, one.is_alarm, one.severity),
        (other.target, other.event_class, other.is_alarm, other.severity),
        strict=True,
    )
    wider = all(mine is None or mine == theirs for mine, theirs in pairs)
    assert zenoh.KeyExpr(expression(realm, one)).includes(zenoh.KeyExpr(expression(realm, other))) == wider


@pytest.mark.parametrize("verb", VERBS)
def test_wildcards_do_not_reach_hidden_keys(verb: str) -> None:
    """`**` takes every event of a target and none of its questions, commands, beats or tokens."""
    hidden = zenoh.KeyExpr(verb_key("live", "plc1", verb, *(["x"] if VERBS[verb].parameter else [])))
    for wide in ("**", "tc3/**", "tc3/1/live/plc1/**", "tc3/1/live/plc1/*", "tc3/1/*/*/*/**", expression("live", Selection())):
        assert not zenoh.KeyExpr(wide).intersects(hidden)
    assert zenoh.KeyExpr("tc3/1/live/plc1/**").intersects(zenoh.KeyExpr(event_key("live", message_sent())))


@given(few_names | names, few_names | names, st.sampled_from(sorted(VERBS)), st.lists(names, max_size=2))
def test_a_hidden_key_comes_back(realm: str, target: str, verb: str, parts: list[str]) -> None:
    """realm, target, verb and parts; the expression for every target matches it."""
    key = verb_key(realm, target, verb, *parts)
    assert parse_verb_key(key) == (realm, target, verb, tuple(parts))
    assert zenoh.KeyExpr(verb_key(realm, None, verb, *[None] * len(parts))).intersects(zenoh.KeyExpr(key))


@given(few_names, few_names, st.sampled_from(sorted(VERBS)), names)
def test_a_rule_covers_the_keys_of_its_verb_only(realm: str, target: str, verb: str, part: str) -> None:
    """Each key of a target is included by exactly one access rule: that of its verb, or that of the events."""
    rules = {str(rule["id"]): zenoh.KeyExpr(str(rule["key_exprs"][0])) for rule in acl_rules(realm, target)}  # type: ignore[index]
    key = zenoh.KeyExpr(verb_key(realm, target, verb, *([part] if VERBS[verb].parameter else [])))
    assert [name for name, rule in rules.items() if rule.includes(key)] == [verb[1:]]
    event = zenoh.KeyExpr(event_key(realm, message_sent(target=target)))
    assert [name for name, rule in rules.items() if rule.includes(event)] == ["events"]
