"""The parts of a text. What arguments look like in it is told in test_catalog.py."""

from bridge.core.placeholders import Slot, template


def test_a_text_is_taken_apart() -> None:
    """Plain parts and placeholders in order; names in lower case, numbers without leading zeros, formats without blanks."""
    assert [part for part in template("{0} of {01, x}: {EventID}{9} {a}") if part] == [
        Slot("{0}", "0", ""),
        " of ",
        Slot("{01, x}", "1", "x"),
        ": ",
        Slot("{EventID}", "eventid", ""),
        Slot("{9}", "9", ""),
        " {a}",
    ]
    assert template("plain") == ("plain",)
