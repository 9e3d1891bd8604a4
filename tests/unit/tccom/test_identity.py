"""Ids and their texts."""

import pytest

from bridge.tccom import identity
from bridge.tccom.identity import IdError, id_text, is_object_id, parse_id, versioned_class_id

CLASS_ID = "a06cf2d1-3600-4c82-a881-28b671fe0a69"


def test_the_gvl_has_the_manuals_numbers() -> None:
    """Manual 5.1: OTCID_CreateNewId, OTCID_FirstFreeId, OTCID_LastFreeId; 8.2: the ids of the two basic interfaces."""
    assert (identity.CREATE_NEW_ID, identity.FIRST_FREE_ID, identity.LAST_FREE_ID) == (0xFFFFFFFF, 0x71010000, 0x710FFFFF)
    assert identity.ITC_UNKNOWN == "00000001-0000-0000-e000-000000000064"
    assert identity.ITCOM_OBJECT == "00000012-0000-0000-e000-000000000064"


def test_fixed_ids_are_none_that_are_given() -> None:
    """System modules and tasks lie outside of the free ids."""
    fixed = [value for name, value in vars(identity).items() if name.endswith("_ID") and isinstance(value, int)]
    given = range(identity.FIRST_FREE_ID, identity.LAST_FREE_ID + 1)
    assert [id_text(value) for value in fixed if value in given] == ["0x71010000", "0x710FFFFF"]
    assert identity.FIRST_SYSTEM_ID < identity.OBJECT_SERVER_ID < identity.LAST_SYSTEM_ID < identity.FIRST_FREE_ID


@pytest.mark.parametrize("text", ["0x71010000", "#x71010000", "16#71010000", "1895890944", " 0x71010000 "])
def test_an_id_is_read_in_each_of_its_spellings(text: str) -> None:
    """Ours, that of class files, that of a PLC, and decimal."""
    assert parse_id(text) == 0x71010000
    assert parse_id(id_text(parse_id(text))) == 0x71010000


@pytest.mark.parametrize("text", ["", "x", "0x", "-1", "0x123456789", "4294967296", "1.5", "0x71010000 0x1"])
def test_what_is_no_id_is_told(text: str) -> None:
    """With what was expected."""
    with pytest.raises(IdError, match="0x71010000"):
        parse_id(text)


def test_an_object_has_neither_of_the_two_special_ids() -> None:
    """0 is no object, 0xFFFFFFFF a request for a new id."""
    assert [is_object_id(number) for number in (0, 1, 0xFFFFFFFE, 0xFFFFFFFF, -1)] == [False, True, True, False, False]


def test_versions_of_a_class_have_ids_of_their_own() -> None:
    """The same class and library give the same id, in every process; another version gives another."""
    one = versioned_class_id(CLASS_ID, "C++ Module Vendor|IncrementerCpp|0.0.0.1")
    assert one == versioned_class_id("{" + CLASS_ID.upper() + "}", "C++ Module Vendor|IncrementerCpp|0.0.0.1")
    assert one != versioned_class_id(CLASS_ID, "C++ Module Vendor|IncrementerCpp|0.0.0.2")


@pytest.mark.parametrize("library", ["", "a|b", "a|b|c", "a|b|1.x", "a|b|1.0|d", "|b|1"])
def test_a_library_id_has_three_parts(library: str) -> None:
    """Vendor, library and a version of numbers."""
    with pytest.raises(IdError, match="vendor"):
        versioned_class_id(CLASS_ID, library)
