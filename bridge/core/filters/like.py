"""What LIKE matches.

Rule 1: `%` is any characters or none, `_` is one character; line ends and NUL are characters.
Rule 2: an ASCII letter matches in either case, every other character only itself (Kelvin sign is no k). No escape.
Rule 3: bounded: the pieces between the `%` are found from left to right and never given back, so that a pattern costs at
        most its length times that of the text.

It is what SQLite's LIKE does, but for texts with NUL, where SQLite stops. The manual says nothing about case or escape.
"""

import re
from typing import Final, Literal, TypeAlias

Simple: TypeAlias = Literal["is", "contains", "starts", "ends"]
"""What a pattern without `_` and with `%` at its ends only asks."""

_FOLD: Final = {upper: upper + 32 for upper in range(ord("A"), ord("Z") + 1)}


def fold(text: str) -> str:
    """The text with its ASCII letters in lower case, as SQLite's lower() does it."""
    return text.translate(_FOLD)


def simple_like(pattern: str) -> tuple[Simple, str] | None:
    """The question of a simple pattern and its folded text; None for other patterns. Only `%` is ("contains", "")."""
    text = pattern.strip("%")
    if "%" in text or "_" in text:
        return None
    if pattern == text:
        return "is", fold(text)
    if not text:
        return "contains", ""
    first, last = pattern[0] == "%", pattern[-1] == "%"
    return "contains" if first and last else "ends" if first else "starts", fold(text)


def like_regex(pattern: str) -> re.Pattern[str]:
    """The pattern as a regular expression for match()."""
    first, *rest = ("".join("." if char == "_" else re.escape(char) for char in part) for part in pattern.split("%"))
    code = first
    if rest:
        # A piece in the middle may stay where it was found first: nothing after it gains by a later place.
        code += "".join(f"(?>.*?{part})" for part in rest[:-1] if part)
        code += f".*{rest[-1]}" if rest[-1] else ""
    if not rest or rest[-1]:
        code += r"\Z"
    return re.compile(code, re.ASCII | re.IGNORECASE | re.DOTALL)
