"""How a filter is written as text, and back: parse() and to_text().

    severity >= error and source.name like '%Main%' and json('/axis') = 3
    event_class in (TestFilterClass, 54cc5482-ad79-4cdc-8c3e-b3983b36ed66) and not is_alarm
    time_raised between 2026-11-22T08:00:00Z and '2026-11-22 09:00+01:00' or source.guid is not empty

Rule 1: it reads as SQL does. NOT binds before AND, AND before OR; keywords, fields and names of values in any case.
Rule 2: a text stands in single quotes, a single quote in it is doubled; a backslash means itself, a line end too.
Rule 3: names of severities, states, kinds and event classes, GUIDs, times and numbers need no quotes. true, false and null
        stand for the texts of JSON.
Rule 4: parse(to_text(expr)) == expr for every filter whose class names are resolved and whose text is not over
        MAX_TEXT. The empty text is the empty filter.

The grammar is LALR(1), a string in this file; fields and values are read from the table in fields.py after the parse, so that
a mistake in them is reported where it stands and with the nearest known word.
"""

import difflib
import math
import re
from functools import cache
from typing import Final, TypeAlias, assert_never

from lark import Lark, Token, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedInput, UnexpectedToken

from bridge.core.filters.ast import (
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
    resolve,
    too_deep,
)
from bridge.core.filters.fields import FIELDS, FLAGS, NAMES, WORDS, ClassResolver, Value, quoted, read, read_integer, show

MAX_TEXT: Final = 300_000
"""Characters of a filter's text, more than a thousand for each condition."""

_GRAMMAR: Final = r"""
start: [either]
?either: all (_OR all)*
?all: opposite (_AND opposite)*
?opposite: NOT opposite -> negation
    | "(" either ")"
    | condition
condition: NAME -> flag
    | operand OPERATOR value -> compare
    | operand [NOT] _LIKE value -> like
    | operand [NOT] _IN "(" value ("," value)* ")" -> among
    | operand [NOT] _BETWEEN value _AND value -> between
    | operand _IS [NOT] _EMPTY -> is_empty
operand: NAME -> field
    | _JSON "(" TEXT ")" -> pointer
value: TEXT | NUMBER | HEX | TIME | GUID | NAME

TEXT: /'(?:[^']|'')*'/
GUID.9: /\{[0-9a-fA-F]{8}(?:-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}\}|[0-9a-fA-F]{8}(?:-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}(?![\w.])/
TIME.8: /\d{4}-\d{2}-\d{2}(?:T[0-9:.]+(?:[Zz]|[+-]\d{2}:\d{2})?)?(?![\w.:+-])/
HEX.7: /0[xX][0-9a-fA-F]+(?![\w.])/
NUMBER.6: /[+-]?(?:\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)(?![\w.])/
OPERATOR: /<>|!=|<=|>=|=|<|>/
_AND.5: /and(?![\w.])/i
_OR.5: /or(?![\w.])/i
_IN.5: /in(?![\w.])/i
_IS.5: /is(?![\w.])/i
_LIKE.5: /like(?![\w.])/i
_BETWEEN.5: /between(?![\w.])/i
_EMPTY.5: /empty(?![\w.])/i
_JSON.5: /json(?![\w.])/i
NOT.5: /not(?![\w.])/i
NAME: /[^\W\d][\w.]*/
%ignore /\s+/
"""

_EXPECTED: Final = {
    "NAME": "a field",
    "TEXT": "a text in single quotes",
    "NUMBER": "a number",
    "OPERATOR": "= != < <= > >=",
    "_AND": "and",
    "_OR": "or",
    "_IN": "in",
    "_IS": "is",
    "_LIKE": "like",
    "_BETWEEN": "between",
    "_EMPTY": "empty",
    "_JSON": "json('...')",
    "NOT": "not",
    "LPAR": "'('",
    "RPAR": "')'",
    "COMMA": "','",
    "$END": "the end",
}
_VALUE_TOKENS: Final = {"TEXT", "NUMBER", "HEX", "TIME", "GUID", "NAME"}
_INTEGER: Final = re.compile(r"[+-]?[0-9]+")
_JSON_WORDS: Final = ("true", "false", "null")
_CONTROL: Final = {code: ord("?") for code in (*range(32), *range(127, 160))}
_LINE: Final = 100

_Parsed: TypeAlias = Tree[Token]


class FilterSyntaxError(ValueError):
    """A text that is no filter: the text, the span from `start` to before `end`, what is wrong, and a hint ("" for none)."""

    def __init__(self, text: str, start: int, end: int, message: str, hint: str = "") -> None:
        self.text, self.start, self.end, self.message, self.hint = text, start, end, message, hint
        super().__init__(text, start, end, message, hint)

    def __str__(self) -> str:
        head = f"{self.message}{', ' if self.hint.endswith('?') else '; '}{self.hint}" if self.hint else self.message
        left = self.text.rfind("\n", 0, self.start) + 1
        right = self.text.find("\n", self.start)
        right = len(self.text) if right < 0 else right
        left = max(left, self.start - _LINE // 2)
        right = min(right, left + _LINE)
        width = max(1, min(self.end, right) - self.start)
        line = self.text[left:right].translate(_CONTROL)
        return f"{head}\n  {line}\n  {' ' * (self.start - left)}{'^' * width}"


@cache
def _parser() -> Lark:
    return Lark(_GRAMMAR, parser="lalr", maybe_placeholders=True, propagate_positions=True)


def parse(text: str, *, resolve_class: ClassResolver | None = None) -> Expr:
    """Read a filter; blank text is Everything().

    FilterSyntaxError for what is not understood, an unknown class name included; AdsError ADS_E_NOMOREHDL for more than 255
    conditions or 64 levels, ADS_E_INVALIDDATA for a bad JSON pointer.
    """
    if len(text) > MAX_TEXT:
        raise FilterSyntaxError(text, MAX_TEXT, len(text), f"a filter of {len(text)} characters, at most {MAX_TEXT} are read")
    try:
        tree = _parser().parse(text)
    except UnexpectedInput as error:
        raise _syntax_error(text, error) from None
    parts = _trees(tree)
    return _Reader(text, resolve_class).expr(parts[0], 1) if parts else Everything()


def _syntax_error(text: str, error: UnexpectedInput) -> FilterSyntaxError:
    match error:
        case UnexpectedCharacters():
            start = error.pos_in_stream or 0
            return _unexpected(text, start, start + 1, set(error.allowed or ()))
        case UnexpectedToken() if error.token.type != "$END":
            token = error.token
            start = token.start_pos or 0
            return _unexpected(text, start, token.end_pos or start + 1, set(error.accepts or error.expected))
        case UnexpectedToken():
            expected = set(error.accepts or error.expected)
            return FilterSyntaxError(text, len(text), len(text) + 1, f"unexpected end; expected {_list(expected)}")
        case _:
            return FilterSyntaxError(text, 0, len(text), str(error))


def _list(expected: set[str]) -> str:
    words = ["a value"] if expected >= _VALUE_TOKENS else []
    rest = expected - _VALUE_TOKENS if words else expected
    words += [word for name, word in _EXPECTED.items() if name in rest]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def _unexpected(text: str, start: int, end: int, expected: set[str]) -> FilterSyntaxError:
    found = text[start:end]
    hint = ""
    if found[0] == "'":
        return FilterSyntaxError(text, start, len(text), "a text without its closing quote", "a quote inside is written ''")
    if found in ('"', "`"):
        hint = "a text stands in single quotes"
    elif text.startswith(("&&", "||"), start) or found in ("&", "|"):
        hint = "write and, or"
    elif found == "!" or found == "~":
        hint = "write not"
    elif text.startswith("==", start) or (found == "=" and text[start - 1 : start] == "="):
        hint = "equality is ="
    elif found.lower() == "null":
        hint = "write is empty"
    return FilterSyntaxError(text, start, end, f"unexpected {found[:40]!r}; expected {_list(expected)}", hint)


class _Reader:
    """From the parse tree to the filter, with one text and one catalog."""

    def __init__(self, text: str, resolve_class: ClassResolver | None) -> None:
        self.text = text
        self.resolve_class = resolve_class

    def error(self, token: Token, message: str, hint: str = "") -> FilterSyntaxError:
        return FilterSyntaxError(self.text, *_span(token), message, hint)

    def expr(self, tree: _Parsed, level: int) -> Expr:
        if level > MAX_DEPTH:
            raise too_deep()
        match tree.data:
            case "either":
                return Or(tuple(self.expr(part, level + 1) for part in _trees(tree)))
            case "all":
                return And(tuple(self.expr(part, level + 1) for part in _trees(tree)))
            case "negation":
                return Not(self.expr(_trees(tree)[-1], level + 1))
            case "flag":
                return self.flag(tree)
            case _:
                return self.condition(tree)

    def flag(self, tree: _Parsed) -> Expr:
        (token,) = tree.children
        assert isinstance(token, Token)
        match name := token.lower():
            case "everything":
                return Everything()
            case _ if name in FLAGS:
                return Flag(name)  # type: ignore[arg-type]  # a row of FLAGS is a FlagName
            case _ if name in NAMES:
                raise self.error(token, f"{token.value!r} is compared with nothing", f"write e.g. {name} = ...")
            case _:
                raise self.error(token, f"unknown test {token.value!r}", _nearest(name, [*FLAGS, *NAMES]))

    def condition(self, tree: _Parsed) -> Expr:
        first, *rest = tree.children
        assert isinstance(first, Tree)
        operand = self.operand(first)
        tokens = [part for part in rest if isinstance(part, Token)]
        values = [part for part in rest if isinstance(part, Tree)]
        negated = any(token.type == "NOT" for token in tokens)
        try:
            plain = self.plain(tree.data, operand, tokens, values)
        except (TypeError, ValueError) as error:
            if isinstance(error, FilterSyntaxError):
                raise
            raise FilterSyntaxError(self.text, tree.meta.start_pos, tree.meta.end_pos, str(error)) from None
        return Not(plain) if negated else plain

    def plain(self, rule: str, operand: Operand, tokens: list[Token], values: list[_Parsed]) -> Expr:
        match rule:
            case "compare":
                op = "!=" if tokens[0] == "<>" else str(tokens[0])
                assert op in ("=", "!=", "<", "<=", ">", ">=")
                return self.with_classes(Compare(operand, op, self.value(operand, values[0])), values)  # type: ignore[arg-type]
            case "like":
                return Like(operand, self.pattern(values[0]))
            case "among":
                return self.with_classes(In(operand, tuple(self.value(operand, value) for value in values)), values)
            case "between":
                low, high = (self.value(operand, value) for value in values)
                return Between(operand, low, high)  # type: ignore[arg-type]  # the node refuses texts
            case _:
                return IsEmpty(operand)

    def operand(self, tree: _Parsed) -> Operand:
        (token,) = tree.children
        assert isinstance(token, Token)
        if tree.data == "pointer":
            return JsonPointer(_unquoted(token))
        field = NAMES.get(token.lower())
        if field is None:
            hint = "a flag stands alone" if token.lower() in FLAGS else _nearest(token.lower(), list(NAMES))
            raise self.error(token, f"unknown field {token.value!r}", hint)
        return field.name

    def value(self, operand: Operand, tree: _Parsed) -> Value:
        (token,) = tree.children
        assert isinstance(token, Token)
        word = _unquoted(token) if token.type == "TEXT" else str(token)
        try:
            if isinstance(operand, JsonPointer):
                return _json_value(token, word)
            field = FIELDS[operand]
            if field.type == "text" and token.type != "TEXT":
                raise self.error(token, f"{field.name} is compared with a text", f"write {quoted(word)}")
            return read(field, word)
        except FilterSyntaxError:
            raise
        except ValueError as error:
            words = word if len(word) <= 40 else ""
            hint = _nearest(words.lower(), list(_choices(operand)))
            raise self.error(token, str(error), hint) from None

    def pattern(self, tree: _Parsed) -> str:
        (token,) = tree.children
        assert isinstance(token, Token)
        if token.type != "TEXT":
            raise self.error(token, "like is followed by a text", f"write {quoted(str(token))}")
        return _unquoted(token)

    def with_classes(self, expr: Expr, values: list[_Parsed]) -> Expr:
        """The condition with class names looked up; the error points to the name."""
        try:
            return resolve(expr, self.resolve_class)
        except UnknownClassError as error:
            for value in values:
                (token,) = value.children
                assert isinstance(token, Token)
                if (_unquoted(token) if token.type == "TEXT" else str(token)) == error.name:
                    raise self.error(token, str(error)) from None
            raise


def _trees(tree: _Parsed) -> list[_Parsed]:
    return [part for part in tree.children if isinstance(part, Tree)]


def _span(token: Token) -> tuple[int, int]:
    return token.start_pos or 0, token.end_pos or 0


def _unquoted(token: Token) -> str:
    return str(token)[1:-1].replace("''", "'")


def _nearest(word: str, words: list[str]) -> str:
    near = difflib.get_close_matches(word, words, 1)
    return f"did you mean {near[0]!r}?" if near else ""


def _choices(operand: Operand) -> tuple[str, ...]:
    return _JSON_WORDS if isinstance(operand, JsonPointer) else WORDS.get(FIELDS[operand].type, ())


def _json_value(token: Token, word: str) -> Value:
    match token.type:
        case "TEXT":
            return word
        case "HEX":
            return read_integer(word)
        case "NUMBER" if _INTEGER.fullmatch(word):
            return read_integer(word)
        case "NUMBER" if math.isfinite(number := float(word)):
            return number
        case "NUMBER":
            raise ValueError(f"{word[:40]} is beyond every double")
        case "NAME" if word.lower() in _JSON_WORDS:
            return word.lower()
        case _:
            raise ValueError(f"{word!r} is no number and has no quotes; a JSON value is compared with a number or a text")


def to_text(expr: Expr) -> str:
    """The canonical text of a filter; parse() reads the same filter from it."""
    return "" if isinstance(expr, Everything) else _show(expr)


def _show(expr: Expr) -> str:
    match expr:
        case Everything():
            return "everything"
        case Flag(name):
            return name
        case Compare(field, op, value):
            return f"{_operand(field)} {op} {_value(field, value)}"
        case Not(Like(field, pattern)):
            return f"{_operand(field)} not like {quoted(pattern)}"
        case Like(field, pattern):
            return f"{_operand(field)} like {quoted(pattern)}"
        case Not(In(field, values)):
            return f"{_operand(field)} not in ({', '.join(_value(field, value) for value in values)})"
        case In(field, values):
            return f"{_operand(field)} in ({', '.join(_value(field, value) for value in values)})"
        case Not(Between(field, low, high)):
            return f"{_operand(field)} not between {_value(field, low)} and {_value(field, high)}"
        case Between(field, low, high):
            return f"{_operand(field)} between {_value(field, low)} and {_value(field, high)}"
        case Not(IsEmpty(field)):
            return f"{_operand(field)} is not empty"
        case IsEmpty(field):
            return f"{_operand(field)} is empty"
        case And(items):
            return " and ".join(f"({_show(item)})" if isinstance(item, Or) else _show(item) for item in items)
        case Or(items):
            return " or ".join(map(_show, items))
        case Not(And() | Or() as item):
            return f"not ({_show(item)})"
        case Not(item):
            return f"not {_show(item)}"
        case _:
            assert_never(expr)


def _operand(operand: Operand) -> str:
    return f"json({quoted(operand.pointer)})" if isinstance(operand, JsonPointer) else operand


def _value(operand: Operand, value: Value) -> str:
    if not isinstance(operand, JsonPointer):
        return show(FIELDS[operand], value)
    return quoted(value) if isinstance(value, str) else repr(value)
