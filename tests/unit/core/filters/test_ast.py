"""The tree: what can be built, what cannot, and its bounds."""

import pytest

from bridge.core.events import ConfirmationState, Severity
from bridge.core.filters.ast import (
    MAX_CONDITIONS,
    MAX_DEPTH,
    And,
    Between,
    Compare,
    Everything,
    Expr,
    Flag,
    In,
    IsEmpty,
    JsonPointer,
    Like,
    Not,
    Operand,
    Or,
    UnknownClassError,
    conditions,
    depth,
    resolve,
)
from bridge.core.hresult import ADS_E_INVALIDDATA, ADS_E_NOMOREHDL, AdsError

A: Expr = Flag("is_alarm")
B: Expr = Flag("is_raised")
C: Expr = Compare("event_id", "=", 3)
G1 = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
G2 = "5819b654-acc7-4328-a54f-a5886769f484"


def test_and_and_or_are_flat_and_keep_their_order() -> None:
    """A & B & C is one And of three, and a group of the same kind is taken in."""
    assert And((A, B, C)) == A & B & C
    assert And((A, Or((B, C)))) == A & (B | C)
    assert Or((A, B, C)) == (A | (B | C))


def test_a_filter_has_no_truth_value() -> None:
    """`and`, `or` and `if` would drop a side silently, so they raise and name the operator to use."""
    with pytest.raises(TypeError, match="&"):
        bool(A and B)
    with pytest.raises(TypeError, match="&"):
        bool(not A)


def test_only_filters_combine() -> None:
    """A bool or a number on the other side is a mistake."""
    with pytest.raises(TypeError):
        A & True  # type: ignore[operator]
    with pytest.raises(TypeError):
        A | 3  # type: ignore[operator]
    with pytest.raises(TypeError, match="int"):
        And((A, 3))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="two"):
        And((A,))


def test_values_are_canonical() -> None:
    """One meaning has one tree: enumerations become ints, GUIDs lose case and braces, a repeated value counts once."""
    assert Compare("severity", "=", Severity.ERROR) == Compare("severity", "=", 3)
    node = Compare("confirmation_state", "=", ConfirmationState.RESET)
    assert type(node.value) is int
    assert Compare("event_class", "=", "{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}").value == G1
    assert In("event_id", (1, 2, 1)).values == (1, 2)


@pytest.mark.parametrize(
    ("operand", "op", "value", "error"),
    [
        ("sevrity", "=", 3, ValueError),
        ("severity", "=", 5, ValueError),
        ("severity", "=", "error", TypeError),
        ("severity", "~", 3, ValueError),
        ("event_id", "=", True, TypeError),
        ("event_id", "=", 1.5, TypeError),
        ("event_id", "=", 10**400, ValueError),
        ("source_name", "<", "a", ValueError),
        ("source_name", "=", 3, TypeError),
        ("source_name", "=", "\ud800", ValueError),
        ("source_guid", "=", "nobody", ValueError),
        ("event_class", "=", "", ValueError),
        ("confirmation_state", "<", 3, ValueError),
        ("kind", "=", "alarm", ValueError),
        (JsonPointer("/a"), "<", "x", TypeError),
        (JsonPointer("/a"), "=", float("nan"), ValueError),
        (JsonPointer("/a"), "=", float("inf"), ValueError),
        (JsonPointer("/a"), "=", None, TypeError),
        (JsonPointer("/a"), "=", True, TypeError),
    ],
)
def test_a_wrong_condition_raises_where_it_is_built(operand: Operand, op: str, value: object, error: type[Exception]) -> None:
    """An unknown field, an operator that the field lacks, or a value of another type: at the call, not at the first event."""
    with pytest.raises(error):
        Compare(operand, op, value)  # type: ignore[arg-type]


def test_other_nodes_check_their_field_too() -> None:
    """LIKE is for texts, BETWEEN for what has an order, IS EMPTY for what can be missing."""
    with pytest.raises(ValueError, match="event_id has no 'like'"):
        Like("event_id", "1%")
    with pytest.raises(ValueError, match="no 'between'"):
        Between("source_name", 1, 2)
    with pytest.raises(ValueError, match="never empty"):
        IsEmpty("severity")
    with pytest.raises(ValueError, match="at least one"):
        In("event_id", ())
    with pytest.raises(TypeError, match="order"):
        Between(JsonPointer("/a"), "a", "b")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="is_alarm"):
        Flag("alarm")  # type: ignore[arg-type]


@pytest.mark.parametrize("pointer", ["", "/", "/a", "/a/b", "//", "/a~0b", "/a~1b", "/0", "/ü ' \0"])
def test_json_pointers_of_rfc_6901_are_taken(pointer: str) -> None:
    """Empty steps, escapes, digits and any character are fine."""
    assert JsonPointer(pointer).pointer == pointer


@pytest.mark.parametrize("pointer", ["a", "/a~", "/~2", "~0", "/a/~/b", "#/a", "/\ud800"])
def test_a_bad_json_pointer_is_invalid_data(pointer: str) -> None:
    """The manual's code for it is ADS_E_INVALIDDATA."""
    with pytest.raises(AdsError) as caught:
        JsonPointer(pointer)
    assert caught.value.code == ADS_E_INVALIDDATA


def test_json_pointer_steps_are_unescaped_in_the_right_order() -> None:
    """~01 is the name ~1, not a slash."""
    assert JsonPointer("/~01/~1/~0/").steps == ("~1", "/", "~", "")
    assert JsonPointer("").steps == ()


def test_255_conditions_are_allowed_and_256_are_not() -> None:
    """A value of IN counts as one and BETWEEN as two, so that nobody gets around the limit with them."""
    many = Or(tuple(Compare("event_id", "=", number) for number in range(MAX_CONDITIONS)))
    assert conditions(many) == MAX_CONDITIONS
    for build in (
        lambda: many | A,
        lambda: many & A,
        lambda: In("event_id", tuple(range(MAX_CONDITIONS + 1))),
        lambda: In("event_id", tuple(range(MAX_CONDITIONS - 1))) & Between("event_id", 1, 2),
    ):
        with pytest.raises(AdsError) as caught:
            build()
        assert caught.value.code == ADS_E_NOMOREHDL


def test_64_levels_are_allowed_and_65_are_not() -> None:
    """No back end can run out of stack."""
    expr = A
    for _ in range(MAX_DEPTH - 1):
        expr = ~expr
    assert depth(expr) == MAX_DEPTH
    with pytest.raises(AdsError) as caught:
        Not(expr)
    assert caught.value.code == ADS_E_NOMOREHDL


def test_a_class_name_means_every_guid_of_that_name() -> None:
    """Two versions of a class share a name; `=` becomes IN, `!=` its opposite; one GUID stays a comparison."""
    names = {"Motion": (G1, G2), "Axis": (G1,)}

    def known(name: str) -> tuple[str, ...]:
        return names.get(name, ())

    assert resolve(Compare("event_class", "=", "Motion"), known) == In("event_class", (G1, G2))
    assert resolve(~(A & Compare("event_class", "!=", "Motion")), known) == Not(And((A, Not(In("event_class", (G1, G2))))))
    assert resolve(Compare("event_class", "!=", "Axis"), known) == Compare("event_class", "!=", G1)
    assert resolve(In("event_class", ("Axis", "Motion")), known) == In("event_class", (G1, G2))
    with pytest.raises(UnknownClassError, match="'Nobody' is unknown") as caught:
        resolve(B | Compare("event_class", "=", "Nobody"), known)
    assert caught.value.name == "Nobody"
    with pytest.raises(UnknownClassError, match="no catalog"):
        resolve(Compare("event_class", "=", "Motion"))
    assert resolve(Compare("event_class", "=", G1)) == Compare("event_class", "=", G1)


def test_the_empty_filter_stays_where_it_was_written() -> None:
    """Nothing is simplified behind the back of whoever wrote the filter."""
    assert Everything() & A == And((Everything(), A))
