"""What a return code means that somebody typed or pasted."""

import pytest

from bridge.core import hresult
from bridge.core.builtin import WIN32, builtin_catalog
from bridge.core.conversion import SUCCESS_EVENT, ads_err_to_event_entry
from bridge.core.meanings import CodeNameError, Meaning, meanings


def names(text: str) -> list[str]:
    """The names of all readings."""
    return [each.name for each in meanings(text)]


@pytest.mark.parametrize(
    "text",
    [
        "0x98110712",
        "0X9811_0712",
        "2551252754",
        "-1743714542",
        "16#98110712",
        "1810",
        "0x712",
        "16#712",
        " 1810 ",
        "ADSERR_DEVICE_INVALIDSTATE",
        "ADS_E_INVALIDSTATE",
        "ads_e_invalidstate",
        "InvalidState",
    ],
)
def test_every_form_of_a_code_is_understood(text: str) -> None:
    """HRESULT, signed or not, ADS code, as Python or a PLC writes them, and all names in any case."""
    assert meanings(text) == (
        Meaning(
            "ADSERR_DEVICE_INVALIDSTATE",
            "ADS_E_INVALIDSTATE",
            "Not possible in this state.",
            0x98110712,
            0x712,
            None,
            ads_err_to_event_entry(0x712),
        ),
    )


def test_a_number_with_several_readings_has_several_meanings() -> None:
    """ADS first, then HRESULT, then Windows."""
    assert names("2") == ["ERR_NORTIME", "ERROR_FILE_NOT_FOUND"]
    assert names("1") == ["ERR_INTERNAL", "S_FALSE", "ERROR_INVALID_FUNCTION"]
    assert names("0") == ["ERR_NOERROR", "S_OK", "ERROR_SUCCESS"]
    assert [(each.hresult, each.win32) for each in meanings("183")] == [(183, None), (0x800700B7, 183)]


def test_a_name_of_several_codes_has_several_meanings() -> None:
    """Two event classes have a Win32Error."""
    assert names("Win32Error") == ["ERR_WIN32ERROR", "ADSERR_CLIENT_W32ERROR"]


def test_windows_codes_by_number_hresult_and_name() -> None:
    """WSAETIMEDOUT is 10060 and 0x8007274C."""
    (found,) = meanings("10060")
    assert (found.name, found.hresult, found.ads_code, found.win32) == ("WSAETIMEDOUT", 0x8007274C, None, 10060)
    assert found.event is not None
    assert found.event.event_class == WIN32
    assert meanings("0x8007274C") == meanings("wsaetimedout") == (found,)
    assert names("0x8007000E") == ["E_OUTOFMEMORY"]


def test_the_manuals_other_spelling_is_known() -> None:
    """5.10.1 writes ADS_E_NOMOREHDL."""
    assert meanings("ADS_E_NOMOREHDL") == meanings("0x716")


@pytest.mark.parametrize("row", hresult.CODES, ids=lambda row: str(row.name))
def test_every_row_is_found_by_each_of_its_forms(row: hresult.Code) -> None:
    """By HRESULT, ADS code, name and short name; 0x740 and 0x756 without an event, no error with SUCCESS_EVENT."""
    forms = [f"0x{row.code:08X}", str(hresult.to_signed(row.code)), row.name, row.short_name]
    forms += [] if row.ads_code is None else [str(row.ads_code)]
    found = {each for form in forms for each in meanings(form) if (each.name, each.hresult) == (row.name, row.code)}
    assert all(row.name in names(form) for form in forms)
    (meaning,) = found
    assert meaning.ads_code == row.ads_code
    if row.code in (0, 0x98110000):
        assert meaning.event == SUCCESS_EVENT
    else:
        assert (meaning.event is None) == (row.ads_code in (None, 0x740, 0x756))


def test_every_event_is_found_by_its_name() -> None:
    """Each event of the newest built-in classes."""
    for name in builtin_catalog().names():
        newest = builtin_catalog().newest(name)
        for entry in newest.events.values():
            assert (newest.guid, entry.id) in [each.event[:2] for each in meanings(entry.name) if each.event is not None]


@pytest.mark.parametrize("text", ["0x98110799", "7000", "99999999999999999999", "-5", "0x98117012", "98110712"])
def test_a_number_without_meaning_has_none(text: str) -> None:
    """Also the HRESULTs that 5.10.1 misprints, and numbers of any size."""
    assert meanings(text) == ()


def test_a_misspelt_name_is_answered_with_names_like_it() -> None:
    """The error keeps the text and the names."""
    with pytest.raises(
        CodeNameError, match="'ADS_E_NOTFUND' is no code and no name of one, did you mean ADS_E_NOTFOUND"
    ) as caught:
        meanings("ADS_E_NOTFUND")
    assert caught.value.name == "ADS_E_NOTFUND"
    assert caught.value.similar[0] == "ADS_E_NOTFOUND"
    for text in ("", "0712", "1.5", "0xzz", "16#", "--5"):
        with pytest.raises(CodeNameError, match="is no code and no name of one"):
            meanings(text)
