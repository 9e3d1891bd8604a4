"""TOML from outside: where its keys stand, and what is refused."""

import pytest

from bridge.core import toml_text

TEXT = b'''\xef\xbb\xbf# a plant
top = 1
[[modules]]
name = "a"
text = """
name = "not a key"
"""
[modules.parameters]
"two words" = 1
dotted.key = 2
[[modules]]
name = "b"
'''


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("top",), 2),
        (("modules", 0), 3),
        (("modules", 0, "name"), 4),
        (("modules", 0, "parameters", "two words"), 9),
        (("modules", 0, "parameters", "dotted", "key"), 10),
        (("modules", 1, "name"), 12),
        (("modules", 1, "state"), 11),
        (("nowhere",), 1),
    ],
)
def test_each_key_has_its_line(path: toml_text.Path, line: int) -> None:
    """What is not there stands where the nearest table around it does; texts of several lines hold no keys."""
    _, lines = toml_text.read(TEXT, "x.toml", "a plant")
    assert lines.of(path) == line


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"a = ", "x.toml:1: Invalid value; expected a TOML file"),
        (b"a = 1\na = 2", "x.toml:2: Cannot overwrite a value; expected a TOML file"),
        (b"a = 1\n\xff", "x.toml:2: bytes that are no UTF-8; expected a TOML file"),
        (b"a = 1\n" + b"a." * 16 + b"a = 1", "x.toml:2: a key of more than 16 parts; expected a plant"),
        (b"a = " + b"[" * 100_000, "x.toml:1: nested too deep; expected a plant"),
    ],
)
def test_what_is_refused(data: bytes, message: str) -> None:
    """File, line, what was expected."""
    with pytest.raises(toml_text.TomlError) as caught:
        toml_text.read(data, "x.toml", "a plant")
    assert str(caught.value).replace(" in column 5", "").replace(" in column 6", "") == message


def test_an_unknown_key_is_told_with_the_one_that_was_meant() -> None:
    """Or with all of them."""
    assert toml_text.unknown_key("nmae", ["name", "class"]) == "unknown key 'nmae', did you mean 'name'?"
    assert toml_text.unknown_key("x", ["name", "class"]) == "unknown key 'x'; expected one of name, class"
