"""ADS return codes and HRESULTs: the rows, their names, and the error that carries one."""

import os
import pickle
import re
from pathlib import Path

import pytest

from bridge.core import hresult
from bridge.core.hresult import (
    AdsError,
    Code,
    by_name,
    failed,
    from_ads,
    from_signed,
    lookup,
    name_of,
    raise_if_failed,
    to_signed,
)

SHARED = Path(os.environ.get("TCBRIDGE_SHARED", Path(__file__).parents[3].parent / "shared"))
PRINTED = {  # the EventLogger manual's damaged names, as its chapter 10.1 prints them
    "ERR_INVALIDAMSLLENGTH": "ERR_INVALIDAMSLENGTH",
    "ERR_INVALIDAMSFAGMENT": "ERR_INVALIDAMSFRAGMENT",
    "ERR_TLSSSEND": "ERR_TLSSEND",
    "ADSERR_DEVICE_NOTIFYHANDINVALID": "ADSERR_DEVICE_NOTIFYHNDINVALID",
    "ADSERR_DEVICE_NOMOREHDL": "ADSERR_DEVICE_NOMOREHDLS",
    "ADSERR_CLIENT_SYNC TIMEOUT": "ADSERR_CLIENT_SYNCTIMEOUT",
    "ADSERR_CLIENT_NOMORESVM": "ADSERR_CLIENT_NOMORESYM",
    "RTERR_PrioEXISTS": "RTERR_PRIOEXISTS",
}


def manual(name: str) -> str:
    path = SHARED / "seeds" / name
    if not path.is_file():
        pytest.skip(f"the manual {path} is not here; TCBRIDGE_SHARED names the folder that holds it")
    return path.read_text(encoding="utf-8")


def test_the_rows_are_those_of_the_eventlogger_manual() -> None:
    """Chapter 10.1 prints 136 rows; ours have its numbers, and its names but for the eight it misprints."""
    text = manual("003_436fa307038a0f32.txt")
    rows = re.findall(r"^0x([0-9A-F]+)\t(\d+)\t0x([0-9A-F]{8})\t([^\t]+)\t", text, re.MULTILINE)
    assert len(rows) == 136
    ours = {row.code: row.name for row in (*hresult.GLOBAL, *hresult.ROUTER, *hresult.ADS, *hresult.RTIME)}
    assert ours == {int(code, 16): PRINTED.get(name, name) for _, _, code, name in rows}
    assert all(int(short, 16) == int(dec) == int(code, 16) & 0xFFFF for short, dec, code, _ in rows)
    assert sorted(PRINTED) == sorted({name for *_, name in rows} - set(ours.values()))


def test_the_names_are_those_of_the_other_manual() -> None:
    """The TE1000 manual's table has the same 136 rows, all with our names."""
    text = manual("000_84bf9adb23dd55e1.txt")
    rows = dict(re.findall(r"(0x9811[0-9A-F]{4}) ([A-Z]+_[A-Z0-9_]+) ", text))
    ours = {f"0x{row.code:08X}": row.name for row in hresult.CODES if row.ads_code is not None}
    assert len(ours) == 136
    assert ours == rows


def test_counts_of_the_groups() -> None:
    """31 global, 14 router, 75 ADS and 16 real-time codes; no code and no name twice; every row says what it means."""
    assert [len(group) for group in (hresult.GLOBAL, hresult.ROUTER, hresult.ADS, hresult.RTIME)] == [31, 14, 75, 16]
    rows = (*hresult.CODES, *hresult.WINSOCK)
    assert len({row.code for row in rows}) == len({row.name for row in rows}) == len(rows) == 136 + 5 + 3 + 3
    assert all(row.text and row.text == row.text.strip() for row in rows)


CONSTANTS = sorted(name for name in vars(hresult) if re.match(r"(ADS_E|E|S|ERROR)_", name))


@pytest.mark.parametrize("name", CONSTANTS)
def test_every_constant_is_a_row_of_that_name(name: str) -> None:
    """A constant and the table never say different numbers."""
    code = getattr(hresult, name)
    row = lookup(code)
    assert row is not None
    assert row.short_name == {"ADS_E_NOMOREHDL": "ADS_E_NOMOREHDLS"}.get(name, name)


def test_the_numbers_of_chapter_ten_win() -> None:
    """5.10.1 prints 0x98117012 for ADS_E_INVALIDSTATE and the like; those numbers are nobody's."""
    assert hresult.ADS_E_INVALIDSTATE == 0x98110712
    assert hresult.ADS_E_NOTINIT == 0x98110718
    assert hresult.ADS_E_INVALIDPARM == 0x9811070B
    assert hresult.ADS_E_NOMEMORY == 0x9811070A
    assert hresult.ADS_E_INVALIDDATA == 0x98110706
    assert lookup(0x98117012) is None


def test_a_code_is_found_signed_and_unsigned() -> None:
    """PLC and C++ hold HRESULTs as signed 32-bit ints; both forms find the row, others find none."""
    assert to_signed(0x98110712) == -1743714542
    assert from_signed(-1743714542) == 0x98110712
    assert (
        lookup(-1743714542)
        == lookup(0x98110712)
        == Code(0x98110712, "ADSERR_DEVICE_INVALIDSTATE", "not possible in this state")
    )
    assert to_signed(183) == from_signed(183) == 183
    assert lookup(0x712) is None
    for code in (2**32, -(2**31) - 1):
        with pytest.raises(ValueError, match="no HRESULT"):
            from_signed(code)


def test_names_of_both_spellings_find_the_row() -> None:
    """ADSERR_DEVICE_X is ADS_E_X, in any case; client, router and global codes have one name only."""
    assert by_name("ADSERR_DEVICE_NOTFOUND") == by_name("ads_e_notfound") == lookup(0x9811070C)
    assert by_name("ERR_NOIO") == lookup(0x9811000A)
    assert by_name("ADSERR_CLIENT_INVALIDPARM") == lookup(0x98110741)
    assert by_name("ADS_E_NOSUCHNAME") is None
    assert name_of(0x98110741) == "ADSERR_CLIENT_INVALIDPARM"
    assert name_of(-1) == "0xFFFFFFFF"


def test_an_ads_code_is_the_low_word() -> None:
    """0x712 is 0x98110712; HRESULTs of others have no ADS code."""
    assert from_ads(0x712) == hresult.ADS_E_INVALIDSTATE
    assert from_ads(0) == 0x98110000
    row = lookup(from_ads(0x1010))
    assert row is not None
    assert row.ads_code == 0x1010
    answer = lookup(hresult.S_FALSE)
    assert answer is not None
    assert answer.ads_code is None
    with pytest.raises(ValueError, match="no ADS return code"):
        from_ads(0x98110712)


def test_only_negative_codes_raise() -> None:
    """S_OK, S_FALSE and ERROR_ALREADY_EXISTS are answers and come back; a negative code raises with its facts."""
    for code in (hresult.S_OK, hresult.S_FALSE, hresult.ERROR_ALREADY_EXISTS, hresult.S_PENDING, 0x7FFFFFFF):
        assert not failed(code)
        assert raise_if_failed(code) == code
    with pytest.raises(AdsError) as caught:
        raise_if_failed(to_signed(hresult.ADS_E_NOTFOUND), "alarm 7 of plc1")
    assert (caught.value.code, caught.value.name) == (0x9811070C, "ADS_E_NOTFOUND")
    assert (caught.value.text, caught.value.detail) == ("not found", "alarm 7 of plc1")


def test_the_error_reads_as_one_line() -> None:
    """Name, number, meaning and detail; without detail or without a row the line is shorter."""
    assert str(AdsError(0x98110712, "raised")) == "ADS_E_INVALIDSTATE (0x98110712): not possible in this state: raised"
    assert str(AdsError(0x98110712)) == "ADS_E_INVALIDSTATE (0x98110712): not possible in this state"
    assert str(AdsError(0x80001234, "x")) == "0x80001234: unknown code: x"


def test_the_error_survives_a_process_boundary() -> None:
    """A pickled error has the same code, detail and line."""
    error = AdsError(hresult.ADS_E_BUSY, "later")
    copy = pickle.loads(pickle.dumps(error))
    assert (copy.code, copy.detail, str(copy)) == (error.code, error.detail, str(error))
