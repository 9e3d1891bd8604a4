"""`tcbridge error`: for people, for programs, in the asked language."""

import json
from pathlib import Path

import pytest

from bridge.cli import run
from bridge.cli.exits import Exit
from bridge.core.builtin import TC_GENERAL_ADS, builtin_catalog

GERMAN = """<?xml version="1.0"?>
<TcModuleClass><DataTypes><DataType>
<Name GUID="{{{guid}}}">TcGeneralAdsEventClass</Name>
<DisplayName TxtId=""><![CDATA[ADS]]></DisplayName>
<EventId>
  <Name Id="1810">InvalidState</Name><DisplayName TxtId=""><![CDATA[Wrong state]]></DisplayName><Severity>Error</Severity>
</EventId>
</DataType></DataTypes>
<Translations><Text TxtId="Wrong state"><Text LcId="1031">Falscher Zustand</Text></Text></Translations>
</TcModuleClass>
"""


def test_a_code_is_explained(capsys: pytest.CaptureFixture[str]) -> None:
    """Name, text, every form of the code, event and event class."""
    assert run(["error", "0x98110712"]) == Exit.OK
    assert capsys.readouterr().out.splitlines() == [
        "ADSERR_DEVICE_INVALIDSTATE: Not possible in this state.",
        "  also called  ADS_E_INVALIDSTATE",
        "  HRESULT      0x98110712 = -1743714542",
        "  ADS code     0x712 = 1810",
        "  event        1810 InvalidState, error",
        "  event class  TcGeneralAdsEventClass 7d760066-d373-4a0c-b0f1-328b1620b0f0",
    ]


@pytest.mark.parametrize("code", ["1810", "0x712", "-1743714542", "ADS_E_INVALIDSTATE"])
def test_every_form_gives_the_same(code: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A negative number is a code and no option."""
    assert run(["error", "0x98110712"]) == Exit.OK
    expected = capsys.readouterr().out
    assert run(["error", code]) == Exit.OK
    assert capsys.readouterr().out == expected


def test_what_has_no_event_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    """ADSERR_CLIENT_ERROR is in no real class; no error is SUCCESS_EVENT; Windows' 0 is an event of its own."""
    assert run(["error", "0x740"]) == Exit.OK
    assert capsys.readouterr().out.splitlines()[-1] == "  event        none"
    assert run(["error", "0"]) == Exit.OK
    out = capsys.readouterr().out
    assert out.count("SUCCESS_EVENT: no class, id 0, verbose") == 2
    assert "  Windows      0x0 = 0\n  event        0 ERROR_SUCCESS, verbose\n" in out


def test_json_has_one_object_per_meaning(capsys: pytest.CaptureFixture[str]) -> None:
    """2 is an ADS code and one of Windows; what does not exist is null."""
    assert run(["error", "2", "--json"]) == Exit.OK
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert first == {
        "name": "ERR_NORTIME",
        "short_name": "ERR_NORTIME",
        "text": "No real time.",
        "hresult": 0x98110002,
        "hresult_signed": -1743716350,
        "ads_code": 2,
        "win32": None,
        "event_class": "bb2a9999-102e-421a-8d3d-b0660e07b1fe",
        "event_id": 2,
        "severity": 3,
        "class_name": "TcSystemEventClass",
        "event_name": "NoRTime",
    }
    assert (second["name"], second["ads_code"], second["win32"], second["hresult"]) == (
        "ERROR_FILE_NOT_FOUND",
        None,
        2,
        0x80070002,
    )
    assert run(["error", "S_PENDING", "--json"]) == Exit.OK
    found = json.loads(capsys.readouterr().out)
    assert [found[name] for name in ("event_class", "event_id", "severity", "class_name", "event_name")] == [None] * 5


def test_an_unknown_number_ends_with_1_and_an_unknown_name_with_2(capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing on stdout; stderr says why, with names like the misspelt one."""
    assert run(["error", "0x98110799"]) == Exit.NO
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "0x98110799 is no known HRESULT, ADS code or number of Windows\n")
    assert run(["error", "ADS_E_NOTFUND"]) == Exit.USAGE
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "did you mean ADS_E_NOTFOUND" in captured.err


def test_a_class_file_has_the_later_word(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its translation is shown in --lang, and its class's name; an event that it lacks is still explained."""
    (tmp_path / "ads.tmc").write_text(GERMAN.format(guid=TC_GENERAL_ADS), encoding="utf-8")
    options = ["--classes", str(tmp_path), "--lang", "de"]
    assert run(["error", "1810", *options]) == Exit.OK
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "ADSERR_DEVICE_INVALIDSTATE: Falscher Zustand"
    assert lines[-1] == f"  event class  ADS {TC_GENERAL_ADS}"
    assert run(["error", "1811", *options]) == Exit.OK
    assert capsys.readouterr().out.splitlines()[0] == "ADSERR_DEVICE_TRANSMODENOTSUPP: Transmission mode not supported."


def test_the_built_in_classes_are_known_without_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    """A filter may name one: it means all its GUIDs, hidden ones too."""
    assert run(["filter", "explain", "event_class = TcRouterEventClass"]) == Exit.OK
    out = capsys.readouterr().out
    assert all(guid in out for guid in builtin_catalog().guids("TcRouterEventClass"))
