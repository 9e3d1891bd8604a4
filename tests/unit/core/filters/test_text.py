"""The text spelling: what it means, how it is written back, and what a mistake says."""

import pytest

from bridge.core.events import ConfirmationState, Severity
from bridge.core.filters.ast import And, Compare, Everything, Expr, Flag, Like, Not, Or
from bridge.core.filters.spelling import where
from bridge.core.filters.text import MAX_TEXT, FilterSyntaxError, parse, to_text
from bridge.core.hresult import ADS_E_INVALIDDATA, ADS_E_NOMOREHDL, AdsError

G1 = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
G2 = "5819b654-acc7-4328-a54f-a5886769f484"
A, B, C = where.is_alarm, where.is_raised, where.event_id == 3
HOUR_8 = 1_795_334_400_000_000_000


def catalog(name: str) -> list[str]:
    """Two versions of Motion, one of Axis."""
    return {"Motion": [G1, G2], "Axis": [G2], "O'Neill": [G1]}.get(name, [])


MEANINGS: list[tuple[str, Expr]] = [
    ("", Everything()),
    (" \t\r\n ", Everything()),
    ("everything", Everything()),
    ("is_alarm and is_raised and event_id = 3", A & B & C),
    ("is_alarm or is_raised and event_id = 3", A | (B & C)),
    ("is_alarm and is_raised or event_id = 3", (A & B) | C),
    ("not is_alarm and is_raised", ~A & B),
    ("not (is_alarm and is_raised)", ~(A & B)),
    ("(is_alarm or is_raised) and event_id = 3", (A | B) & C),
    ("NOT Is_Alarm AND(Is_Raised)", ~A & B),
    ("not not is_alarm", ~~A),
    ("severity >= error", where.severity >= Severity.ERROR),
    ("severity>=3", where.severity >= Severity.ERROR),
    ("severity <> 'Warning'", where.severity != Severity.WARNING),
    ("severity in (error, CRITICAL)", where.severity.in_(Severity.ERROR, Severity.CRITICAL)),
    ("severity not between info and error", ~where.severity.between(Severity.INFO, Severity.ERROR)),
    ("source.name like '%Main%'", where.source_name.like("%Main%")),
    ("source_name not like 'it''s%'", ~where.source_name.like("it's%")),
    ("source_name = ''", where.source_name == ""),
    ("source_name = '\\'", where.source_name == "\\"),
    ("source_name = 'a\nb\0c\"'", where.source_name == 'a\nb\0c"'),
    ("source.name is empty", where.source_name.is_empty()),
    ("source.guid is not empty", where.source_guid.is_not_empty()),
    ("source.id in (0x08502000, 3)", where.source_id.in_(0x08502000, 3)),
    ("event_id = -1 or event_id = +1", (where.event_id == -1) | (where.event_id == 1)),
    ("event_id < 18446744073709551616", where.event_id < 2**64),
    (f"event_class = {G1}", where.event_class == G1),
    (f"class = {{{G1.upper()}}}", where.event_class == G1),
    (f"event_class != '{G1}'", where.event_class != G1),
    ("event_class = Motion", where.event_class.in_(G1, G2)),
    ("event_class = 'Axis'", where.event_class == G2),
    ("event_class = 'O''Neill'", where.event_class == G1),
    ("event_class != Motion", ~where.event_class.in_(G1, G2)),
    (f"event_class not in (Axis, {G1})", ~where.event_class.in_(G2, G1)),
    ("time >= 2026-11-22T08:00:00Z", where.time_ns >= HOUR_8),
    ("time.raised > '2026-11-22 09:00+01:00'", where.time_raised_ns > HOUR_8),
    ("time_cleared between 2026-11-22 and 2026-11-22T08:00", where.time_cleared_ns.between(HOUR_8 - 28_800 * 10**9, HOUR_8)),
    (f"time_confirmed_ns = {HOUR_8}", where.time_confirmed_ns == HOUR_8),
    ("confirmation = WaitForConfirmation", where.confirmation_state == ConfirmationState.WAIT_FOR_CONFIRMATION),
    ("kind in (alarm_raised, AlarmCleared)", where.kind.in_("alarm_raised", "alarm_cleared")),
    ("json('/axis') = 3", where.json("/axis") == 3),
    ("JSON ( '/axis' ) = 3.0", where.json("/axis") == 3.0),
    ("json('/it''s') = '3'", where.json("/it's") == "3"),
    ("json('') in (true, 'x', null, -1.5e3)", where.json("").in_(True, "x", None, -1500.0)),
    ("json('/a') not between 1 and 2", ~where.json("/a").between(1, 2)),
    ("json('/a') is empty", where.json("/a").is_empty()),
    ("unique_id > 5", where.unique_id > 5),
    ("target = 'and' or target like 'or'", (where.target == "and") | where.target.like("or")),
]


@pytest.mark.parametrize(("text", "expr"), MEANINGS)
def test_a_text_means_the_same_as_its_python_spelling(text: str, expr: Expr) -> None:
    """Precedence, keywords in any case, aliases, quoting, names and numbers; and the canonical text reads back."""
    assert parse(text, resolve_class=catalog) == expr
    assert parse(to_text(expr)) == expr


def test_the_canonical_text_is_the_readable_one() -> None:
    """Names instead of numbers, times instead of nanoseconds, `is not empty` instead of a leading not, few parentheses."""
    expr = parse(
        f"severity>=3 and not(source.guid is empty)and(is_alarm or is_raised) and not(time<{HOUR_8}) and not(not(is_alarm))"
    )
    assert to_text(expr) == (
        "severity >= error and source_guid is not empty and (is_alarm or is_raised)"
        " and not time_ns < '2026-11-22T08:00:00Z' and not not is_alarm"
    )


def test_a_tree_that_holds_the_empty_filter_has_a_text() -> None:
    """`everything` stands for it inside; alone it is the empty text."""
    nothing = Not(Everything())
    assert to_text(Everything()) == ""
    assert to_text(nothing) == "not everything"
    assert parse("not everything") == nothing
    assert parse(to_text(Everything() & A)) == And((Everything(), A))


ERRORS: list[tuple[str, str, str, str]] = [
    ("sevrity >= error", "sevrity", "unknown field 'sevrity'", "did you mean 'severity'?"),
    ("severity >= eror", "eror", "'eror' is no severity", "did you mean 'error'?"),
    ("is_alrm", "is_alrm", "unknown test 'is_alrm'", "did you mean 'is_alarm'?"),
    ("severity", "severity", "compared with nothing", "severity ="),
    ("is_alarm = 3", "is_alarm", "unknown field", "a flag stands alone"),
    ("severity >= error an is_alarm", "an", "unexpected 'an'", ""),
    ("is_alarm && is_raised", "&", "unexpected '&'", "write and, or"),
    ('source.name = "x"', '"', "unexpected", "single quotes"),
    ("source.name = 'x", "'x", "closing quote", "''"),
    ("severity == error", "=", "unexpected '='", "equality is ="),
    ("! is_alarm", "!", "unexpected '!'", "write not"),
    ("is_alarm)", ")", "expected the end", ""),
    ("target = plc1", "plc1", "compared with a text", "write 'plc1'"),
    ("target like 3", "3", "like is followed by a text", "write '3'"),
    ("event_id = 1.5", "1.5", "no integer", ""),
    ("event_id = error", "error", "no integer", ""),
    ("json('/a') = foo", "foo", "no quotes", ""),
    ("json('/a') = 1e999", "1e999", "double", ""),
    ("json('/a') < 'x'", "json('/a') < 'x'", "no order", ""),
    ("source_name >= 'x'", "source_name >= 'x'", "has no '>='", ""),
    ("severity is empty", "severity is empty", "never empty", ""),
    ("time > 2026-13-01", "2026-13-01", "no time", ""),
    ("source.guid = 'x'", "'x'", "no GUID", ""),
    ("event_class = Nobody", "Nobody", "unknown", ""),
    ("event_class in (Motion, 'No One')", "'No One'", "'No One' is unknown", ""),
    ("severity not error", "error", "expected in, like or between", ""),
    ("event_id = 99x", "9", "expected a value", ""),
    ("is_alarm and\n  sevrity = 3", "sevrity", "unknown field", "severity"),
]


@pytest.mark.parametrize(("text", "span", "message", "hint"), ERRORS)
def test_a_mistake_is_pointed_at(text: str, span: str, message: str, hint: str) -> None:
    """The error says what and where, and what was probably meant."""
    with pytest.raises(FilterSyntaxError) as caught:
        parse(text, resolve_class=catalog)
    error = caught.value
    assert text[error.start : error.end] == span
    assert message in error.message
    assert hint in error.hint


def test_an_error_prints_text_and_caret() -> None:
    """What a person sees in the terminal."""
    with pytest.raises(FilterSyntaxError) as caught:
        parse("is_alarm and\n\tsevrity >= error")
    assert str(caught.value) == "unknown field 'sevrity', did you mean 'severity'?\n  ?sevrity >= error\n   ^^^^^^^"
    with pytest.raises(FilterSyntaxError) as caught:
        parse("(is_alarm")
    assert str(caught.value) == "unexpected end; expected ')'\n  (is_alarm\n           ^"
    assert caught.value.start == 9


def test_a_long_text_is_shown_around_the_mistake() -> None:
    """The line of the caret stays short."""
    with pytest.raises(FilterSyntaxError) as caught:
        parse("is_alarm and " * 200 + "sevrity = 3" + " and is_alarm" * 200)
    _, line, carets = str(caught.value).split("\n")
    assert len(line) < 110
    assert line[carets.index("^") :].startswith("sevrity")
    assert carets.count("^") == len("sevrity")


def test_a_class_name_without_a_catalog_is_an_error_that_says_so() -> None:
    """The GUID would do."""
    with pytest.raises(FilterSyntaxError, match="no catalog") as caught:
        parse("event_class = Motion")
    assert caught.value.start == 14


def test_too_many_conditions_have_the_code_of_the_manual() -> None:
    """256 conditions: ADS_E_NOMOREHDL."""
    parse(" or ".join(["event_id = 1"] * 255))
    with pytest.raises(AdsError) as caught:
        parse(" or ".join(["event_id = 1"] * 256))
    assert caught.value.code == ADS_E_NOMOREHDL


def test_a_bad_json_pointer_has_the_code_of_the_manual() -> None:
    """ADS_E_INVALIDDATA."""
    with pytest.raises(AdsError) as caught:
        parse("json('axis') = 3")
    assert caught.value.code == ADS_E_INVALIDDATA


@pytest.mark.parametrize(
    "text",
    ["not " * 65 + "is_alarm", "not " * 70_000 + "is_alarm", "(is_alarm and event_id=1 or " * 70 + "is_alarm" + ")" * 70],
)
def test_deep_nesting_is_refused_without_a_recursion_error(text: str) -> None:
    """65 levels or 70,000: the same answer."""
    with pytest.raises(AdsError) as caught:
        parse(text)
    assert caught.value.code == ADS_E_NOMOREHDL


def test_parentheses_that_group_nothing_cost_nothing() -> None:
    """They are no levels, and a missing one is a syntax error however many there are."""
    assert parse("(" * 3000 + "is_alarm" + ")" * 3000) == A
    with pytest.raises(FilterSyntaxError, match="unexpected end"):
        parse("(" * 50_000 + "is_alarm")


def test_a_text_has_a_longest_length() -> None:
    """A filter may come from another machine."""
    with pytest.raises(FilterSyntaxError, match="at most"):
        parse(" " * (MAX_TEXT + 1))


def test_trees_built_by_hand_round_trip() -> None:
    """Groups inside groups, a negated group, a negated condition."""
    like = Like("target", "it's_%")
    number = Compare("event_id", "!=", -5)
    trees: list[Expr] = [
        Not(And((like, number))),
        And((Or((like, Not(number))), Not(Or((number, Flag("is_message")))))),
        Or((And((like, number)), Not(Not(Not(like))))),
        Not(Not(And((Not(like), Not(Not(number)))))),
    ]
    for tree in trees:
        assert parse(to_text(tree)) == tree
