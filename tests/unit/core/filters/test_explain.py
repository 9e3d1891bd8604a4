"""What `filter explain` shows."""

from bridge.core.filters.explain import explain
from bridge.core.filters.text import parse


def test_a_filter_is_explained_from_every_side() -> None:
    """Tree, keys, what is left for the predicate, and SQL with its parameters."""
    text = "severity >= error and source.name like '%Main%' and not json('/axis') = 3"
    assert "\n".join(explain(parse(text), "live").lines()) == (
        "filter    severity >= error and source_name like '%Main%' and not json('/axis') = 3\n"
        "tree\n"
        "  and\n"
        "    severity >= error\n"
        "    source_name like '%Main%'\n"
        "    not\n"
        "      json('/axis') = 3\n"
        "keys      may let too much through\n"
        "  tc3/1/live/*/event/*/*/error\n"
        "  tc3/1/live/*/event/*/*/critical\n"
        "predicate source_name like '%Main%' and not json('/axis') = 3\n"
        "SQL       may let too much through\n"
        "  WHERE (severity >= ? AND (has_source_name = 1 AND instr(lower(source_name), ?) > 0))\n"
        "  ?1 = 3\n"
        "  ?2 = 'main'"
    )


def test_a_filter_that_the_keys_decide_leaves_nothing() -> None:
    """An exact cover needs no predicate."""
    explained = explain(parse(""), "replay-1")
    assert explained.keys == ("tc3/1/replay-1/*/event/*/*/*",)
    assert explained.keys_exact
    assert explained.residual == ""
    assert explained.lines()[0] == "filter    everything"


def test_a_filter_that_nothing_can_match_says_so() -> None:
    """It subscribes to no key."""
    explained = explain(parse("is_alarm and is_message"), "live")
    assert explained.keys == ()
    assert "  nothing can match" in explained.lines()


def test_a_filter_for_the_log_has_no_keys_and_says_why() -> None:
    """The unique id is given when an event is stored."""
    explained = explain(parse("unique_id > 3"), "live")
    assert explained.keys is None
    assert "unique_id" in explained.no_keys
    assert any(line.startswith("keys      none: unique_id") for line in explained.lines())
