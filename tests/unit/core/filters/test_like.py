"""LIKE: wildcards, case and characters that other matchers stumble over."""

import sqlite3
import time
from collections.abc import Iterator

import pytest

from bridge.core.filters.like import fold, like_regex, simple_like


@pytest.fixture(scope="module")
def sqlite() -> Iterator[sqlite3.Connection]:
    """SQLite is the oracle for LIKE."""
    connection = sqlite3.connect(":memory:")
    yield connection
    connection.close()


KELVIN, LONG_S, DOTTED_I = "\u212a", "\u017f", "\u0130"
PATTERNS = [
    "",
    "%",
    "_",
    "%%",
    "a",
    "A%",
    "%a",
    "%a%",
    "a_c",
    "%b_d%",
    "a%c%e",
    "_%_",
    "%_",
    "__",
    "k",
    "s%",
    "%i%",
    "ä",
    "%Ä%",
]
PATTERNS += [
    "a\nb",
    "%\n",
    "'",
    '"',
    "%'%",
    "[a]%",
    "a.c",
    "a*",
    "\\%",
    "\\_",
    "^a$",
    "a%b%b",
    "%a%a%a",
    "(?i)a",
    "{1}",
    " %",
    "% ",
]
TEXTS = ["", "a", "A", "abc", "ABC", "aXc", "abcde", "aBCdE", "abb", "ab", "aaa", "aa", KELVIN, "k", "K", LONG_S, "s", "S"]
TEXTS += [
    DOTTED_I,
    "i",
    "ä",
    "Ä",
    "a\nb",
    "\n",
    "'",
    '"',
    "[a]",
    "a.c",
    "%",
    "_",
    "\\",
    "\\x",
    "^a$",
    "(?i)a",
    "{1}",
    " ",
    "a ",
]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_like_is_what_sqlite_says(sqlite: sqlite3.Connection, pattern: str) -> None:
    """Each nasty text against each nasty pattern, compared with the same question to SQLite."""
    match = like_regex(pattern).match
    for text in TEXTS:
        (expected,) = sqlite.execute("SELECT ? LIKE ?", (text, pattern)).fetchone()
        assert (match(text) is not None) == bool(expected), (text, pattern)


def test_nul_is_a_character() -> None:
    """SQLite stops at NUL; here it is a character like any other."""
    assert like_regex("a_b").match("a\0b")
    assert like_regex("%b").match("a\0b")
    assert not like_regex("a").match("a\0b")


def test_only_ascii_folds() -> None:
    """fold() is SQLite's lower(): Kelvin sign and dotted I keep their form."""
    assert fold("ABCZ" + KELVIN + DOTTED_I + "Ä") == "abcz" + KELVIN + DOTTED_I + "Ä"


@pytest.mark.parametrize(
    ("pattern", "simple"),
    [
        ("", ("is", "")),
        ("Ab", ("is", "ab")),
        ("%", ("contains", "")),
        ("%%%", ("contains", "")),
        ("%Main%", ("contains", "main")),
        ("%%x%%", ("contains", "x")),
        ("PLC.%", ("starts", "plc.")),
        ("%.fbX", ("ends", ".fbx")),
        ("a%b", None),
        ("a_", None),
        ("%_%", None),
    ],
)
def test_simple_patterns_are_recognised(pattern: str, simple: tuple[str, str] | None) -> None:
    """They need no regular expression, and SQL can ask them exactly."""
    assert simple_like(pattern) == simple


def test_a_hostile_pattern_costs_no_more_than_its_length_times_the_text() -> None:
    """Fifty times % against a text that almost matches: a backtracking matcher would not come back."""
    match = like_regex("%a" * 50 + "%b_c").match
    began = time.perf_counter()
    assert match("a" * 8000) is None
    assert time.perf_counter() - began < 2
