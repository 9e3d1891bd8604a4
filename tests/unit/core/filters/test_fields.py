"""The field table: that it fits the event, and how words of the text become values."""

import pytest

from bridge.core.events import MessageSent
from bridge.core.filters.fields import FIELDS, FLAGS, NAMES, canonical, read, show
from bridge.core.filters.spelling import Equality, Where
from bridge.core.times import TimeError


def test_every_field_is_an_attribute_of_the_event_or_of_the_log() -> None:
    """A field that no event has would be false for ever."""
    attributes = {*MessageSent.__struct_fields__, "kind"}
    assert {name for name in FIELDS if name not in attributes} == {"unique_id"}
    assert FIELDS["unique_id"].log_only


def test_every_field_and_flag_has_its_python_spelling() -> None:
    """`where` is written out for type checkers and editors; this keeps it in step with the table."""
    spelled = {name for name in vars(Where) if not name.startswith("_")}
    assert spelled == {*FIELDS, *FLAGS, "json", "everything"}
    for name in FIELDS:
        operand = getattr(Where, name)
        assert isinstance(operand, Equality)
        assert operand.operand == name


def test_no_word_means_two_things() -> None:
    """Names and aliases are lower case and unique; no flag is called like a field."""
    words = [word for row in FIELDS.values() for word in (row.name, *row.aliases)]
    assert len(words) == len(set(words)) == len(NAMES)
    assert all(word == word.lower() for word in words)
    assert not set(FLAGS) & set(NAMES)


def test_the_key_tells_three_fields() -> None:
    """Target, event class and severity stand in the key; message or alarm is a flag."""
    assert {name for name, field in FIELDS.items() if field.chunk} == {"target", "event_class", "severity"}


@pytest.mark.parametrize(
    ("name", "word", "value"),
    [
        ("severity", "Error", 3),
        ("severity", "3", 3),
        ("confirmation_state", "WaitForConfirmation", 2),
        ("confirmation_state", "wait_for_confirmation", 2),
        ("kind", "AlarmRaised", "alarm_raised"),
        ("event_id", "0x10", 16),
        ("event_id", "-1", -1),
        ("time_ns", "1970-01-01T00:00:01Z", 1_000_000_000),
        ("time_ns", "1970-01-01 01:00:01+01:00", 1_000_000_000),
        ("time_ns", "17", 17),
        ("event_class", "{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}", "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"),
        ("event_class", "MyEvents", "MyEvents"),
        ("source_name", "3", "3"),
    ],
)
def test_words_become_values(name: str, word: str, value: object) -> None:
    """Names in any case, times as ISO 8601 or ns, numbers decimal or hexadecimal; and what is shown reads back."""
    field = FIELDS[name]
    read_value = read(field, word)
    assert read_value == value
    assert type(read_value) is type(value)
    shown = show(field, read_value)
    assert read(field, shown.strip("'")) == value


@pytest.mark.parametrize(
    ("name", "word"),
    [("severity", "5"), ("severity", "fatal"), ("kind", "3"), ("event_id", "1.0"), ("event_id", "9" * 402), ("vendor_id", "x")],
)
def test_words_that_mean_nothing_are_refused(name: str, word: str) -> None:
    """The error is a ValueError that says what was expected."""
    with pytest.raises(ValueError, match=r"expected|outside|integer"):
        read(FIELDS[name], word)


def test_a_bad_time_says_how_a_time_looks() -> None:
    """The error is that of times.py."""
    with pytest.raises(TimeError, match="2026-11-22T08:30"):
        read(FIELDS["time_ns"], "yesterday")


def test_times_are_shown_without_needless_digits() -> None:
    """The nanoseconds are there when there are any; what is no time of this era stays a number."""
    field = FIELDS["time_ns"]
    assert show(field, 1_500_000_000) == "'1970-01-01T00:00:01.5Z'"
    assert show(field, 1_000_000_000) == "'1970-01-01T00:00:01Z'"
    assert show(field, 1) == "'1970-01-01T00:00:00.000000001Z'"
    assert show(field, 0) == "0"
    assert show(field, 2**63) == str(2**63)


def test_canonical_refuses_other_types() -> None:
    """A text is no number and a bool is no integer."""
    with pytest.raises(TypeError):
        canonical(FIELDS["event_id"], "3")
    with pytest.raises(TypeError):
        canonical(FIELDS["time_ns"], False)
    with pytest.raises(TypeError):
        canonical(FIELDS["target"], b"plc1")
