"""Faulty event classes: each fault is found with its file and line, and nothing is found where nothing is."""

import os
from pathlib import Path

import pytest

from bridge.core.class_draft import Draft, draft
from bridge.core.class_lint import RULES, Finding, Observed, lint
from bridge.core.tmc import Problem, read_classes

SHARED = Path(os.environ.get("TCBRIDGE_SHARED", Path(__file__).parents[3].parent / "shared"))
FOLDER = SHARED / "data" / "tmc"
real_files = pytest.mark.skipif(
    not FOLDER.is_dir(),
    reason=f"the real class files are not in {FOLDER}; TCBRIDGE_SHARED names the folder that holds data/tmc",
)

OLD = "11111111-0000-4000-8000-000000000001"
FAULTY = """<TcModuleClass>
  <Translations>
    <Text TxtId="Pump {0} ran dry">
      <Text LcId="1031">Pumpe lief trocken</Text>
    </Text>
    <Text TxtId="Pumps"><Text LcId="1031">Pumpen</Text></Text>
    <Text TxtId="KEY_HOT">
      <Text LcId="1033">Pump {0} is at {1,f}</Text>
      <Text LcId="1031">Pumpe {0}: {1,f} Grad, {1,k}</Text>
    </Text>
  </Translations>
  <DataTypes>
    <DataType>
      <Name GUID="{11111111-0000-4000-8000-000000000002}">Pump</Name>
      <DisplayName>Pumps</DisplayName>
      <EventId>
        <Name Id="1">Dry</Name>
        <DisplayName>Pump {0} ran dry</DisplayName>
        <Severity>Error</Severity>
      </EventId>
      <EventId>
        <Name Id="1">Wet</Name>
        <DisplayName>KEY_HOT</DisplayName>
        <Severity>Error</Severity>
      </EventId>
      <EventId>
        <Name Id="3">Dry</Name>
        <DisplayName>Pumps</DisplayName>
        <Severity>Error</Severity>
      </EventId>
      <EventId>
        <Name Id="4">NoSeverity</Name>
        <DisplayName>Pumps</DisplayName>
      </EventId>
      <EventId>
        <Name Id="5">Long</Name>
        <DisplayName>{13}LONG</DisplayName>
        <Severity>Sehr schlimm</Severity>
      </EventId>
      <EventId>
        <Name Id="eight">BadId</Name>
        <DisplayName>Pumps</DisplayName>
        <Severity>Error</Severity>
      </EventId>
      <Hides><Hide GUID="{11111111-0000-4000-8000-000000000001}"/></Hides>
    </DataType>
    <DataType>
      <Name GUID="{11111111-0000-4000-8000-000000000003}">Pump</Name>
      <DisplayName>Pumps</DisplayName>
      <EventId>
        <Name Id="1">Dry</Name>
        <DisplayName>Pumps</DisplayName>
        <Severity>Error</Severity>
      </EventId>
    </DataType>
    <DataType>
      <Name GUID="{11111111-0000-4000-8000-000000000001}">Pump</Name>
      <DisplayName>Pumps</DisplayName>
      <EventId>
        <Name Id="1">Dry</Name>
        <DisplayName>Pumps</DisplayName>
        <Severity>Error</Severity>
      </EventId>
    </DataType>
  </DataTypes>
  <Modules><Module><EventClasses>
    <EventClass><Type GUID="{11111111-0000-4000-8000-000000000001}">Pump</Type></EventClass>
  </EventClasses></Module></Modules>
</TcModuleClass>
""".replace("LONG", "x" * 2000)


def findings(text: str, name: str = "pump.tmc", *observed: Observed, languages: tuple[int, ...] = ()) -> list[Finding]:
    """What is found in a file's text."""
    data = text.encode()
    result = read_classes(data, name)
    return lint([draft(data, name, result)], result.problems, languages=languages, observed=observed)


def line_of(text: str, nth: int = 1) -> int:
    """The line of the n-th occurrence in the faulty file."""
    return FAULTY[: [place for place in range(len(FAULTY)) if FAULTY.startswith(text, place)][nth - 1]].count("\n") + 1


def test_each_fault_is_found_where_it_is() -> None:
    """A class with one fault of every kind: the reader refuses it, the linter says all that is wrong with it."""
    found = {(each.rule, each.line) for each in findings(FAULTY)}
    event = [line_of("<EventId>", number) for number in range(1, 9)]
    classes = [line_of("<DataType>", number) for number in (1, 2, 3)]
    assert found == {
        ("placeholders-differ", line_of("Pumpe lief trocken")),
        ("unknown-format", line_of("{1,k}")),
        ("duplicate-id", event[1]),
        ("duplicate-name", event[2]),
        ("severity-missing", event[3]),
        ("severity-missing", event[4]),
        ("missing-language", event[0]),
        ("missing-language", event[4]),
        ("missing-language", classes[0]),
        ("text-too-long", event[4]),
        ("arguments-too-long", event[4]),
        ("unreadable", line_of('<Name Id="eight"')),
        ("ambiguous-name", classes[0]),
        ("ambiguous-name", classes[1]),
        ("hidden-in-use", line_of("<EventClass><Type")),
    }


def test_every_rule_can_be_broken() -> None:
    """The faulty class breaks each of RULES."""
    assert {each.rule for each in findings(FAULTY)} == set(RULES)


def test_a_finding_says_what_and_what_was_expected() -> None:
    """As one line, with file, line, rule, the class and the event."""
    lines = [str(each) for each in findings(FAULTY)]
    assert (
        f"pump.tmc:{line_of('Pumpe lief trocken')}: placeholders-differ: event Pump.Dry: no placeholder in de-DE (1031); "
        "expected 1 placeholder ({0}) as in 'Pump {0} ran dry'" in lines
    )
    assert any("duplicate-name: event class Pump: name Dry is used by ids 1 and 3" in line for line in lines)
    assert any("a module uses Pump (11111111-0000-4000-8000-000000000001); Pump (" in line for line in lines)


def test_a_key_is_no_text() -> None:
    """A display text that is a key for the English text is not compared with its translations; order is free."""
    text = """<TcModuleClass><Translations><Text TxtId="KEY"><Text LcId="1033">{0} of {1}</Text>
    <Text LcId="1031">von {1} sind {0} da, {0}!</Text></Text></Translations><DataTypes><DataType>
    <Name GUID="{11111111-0000-4000-8000-000000000002}">Pump</Name><EventId><Name Id="1">A</Name>
    <DisplayName>KEY</DisplayName><Severity>Info</Severity></EventId></DataType></DataTypes></TcModuleClass>"""
    assert findings(text) == []
    assert [each.rule for each in findings(text, languages=(1031, 1036))] == ["missing-language"]


def test_prose_is_english() -> None:
    """A class without any text under 1033 has its display texts for English; one event twice is one fault."""
    event = '<EventId><Name Id="1">A</Name><DisplayName>Dry</DisplayName><Severity>Info</Severity></EventId>'
    text = (
        f"""<TcModuleClass><DataTypes><DataType><Name GUID="{OLD}">Pump</Name>{event}</DataType></DataTypes></TcModuleClass>"""
    )
    assert findings(text, languages=(1033,)) == []
    assert [each.rule for each in findings(text.replace(event, event * 2))] == ["duplicate-id"]


def test_a_hidden_class_in_a_recording() -> None:
    """Seen in use, the hidden version is reported with where and how often; the current one is not."""
    text = FAULTY.replace("<EventClass><Type", "<Nothing><Type").replace("</Type></EventClass>", "</Type></Nothing>")
    seen = Observed("plant.mcap", OLD, 1234)
    used = [each for each in findings(text, "p.tmc", seen, Observed("x.mcap", OLD[:-1] + "2", 1)) if "hidden" in each.rule]
    assert [(each.line, each.event_class) for each in used] == [(line_of("<DataType>", 3), OLD)]
    assert "occurs 1,234 times in plant.mcap; Pump (11111111-0000-4000-8000-000000000002) hides it" in used[0].message


def test_a_file_that_is_cut_off() -> None:
    """What is whole is linted, what is not is said."""
    cut = FAULTY[: FAULTY.index("<DataType>", FAULTY.index("<DataType>") + 1) + 200]
    found = findings(cut)
    assert "unreadable" in {each.rule for each in found}


def test_a_file_that_is_refused_has_its_problem() -> None:
    """A problem without a draft is a finding."""
    problem = Problem("x.tmc", 3, "a DTD is refused; expected a file without DOCTYPE")
    assert lint([Draft("x.tmc", ())], [problem]) == [Finding("x.tmc", 3, "unreadable", problem.message)]


@real_files
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        (
            "aag-test-bench.tsproj",
            [
                (155 + 5 * number, "missing-language", f"event MsgEvents.{word}Msg")
                for number, word in enumerate(("Verbose", "Info", "Warning", "Error", "Critical"))
            ],
        ),
        (
            "packml-vffs-demo.tmc",
            [(1, "missing-language", f"class {name}") for name in ("PullWheels", "Sealer", "Unwind", "VFFSDemo")],
        ),
        ("beckhoff-filter-sample.tmc", []),
        ("beckhoff-publisher.tmc", []),
        ("beckhoff-resource-import.tmc", []),
        ("beckhoff-start-stop.tmc", []),
    ],
)
def test_what_is_really_wrong_with_real_files(name: str, expected: list[tuple[int, str, str]]) -> None:
    """The hidden MsgEvents was never translated; the names of the PackML classes have a key and no text. The rest is clean."""
    found = findings((FOLDER / name).read_text("utf-8-sig"), name)
    assert [(each.line, each.rule, each.message.partition(":")[0]) for each in found] == expected


@real_files
def test_real_files_in_french() -> None:
    """Asked for French, every text of the test bench lacks it: 12 of the current versions, and 6 of the hidden one."""
    found = findings((FOLDER / "aag-test-bench.tsproj").read_text(), "aag", languages=(1036,))
    assert [each.rule for each in found] == ["missing-language"] * 18


FURTHER = f"""<TcModuleClass><DataTypes><DataType><Name GUID="{OLD}">Pump</Name><EventId><Name Id="1">A</Name>
<DisplayName>Dry</DisplayName><Severity>Info</Severity><Properties>
<Property><Name>Cause[1]</Name><Value>Dirt in the inlet</Value></Property>
<Property><Name>Remedy[1]</Name><Value>Clean the sieve</Value></Property>
<Property><Name>Detail[Wiring]</Name><Value>Sheet 12</Value></Property>
<Property><Name>DetailComment[Wiring]</Name><Value>nobody reads this</Value></Property>
</Properties></EventId>
<Translations><Text TxtId="Dry"><Text LcId="1031">Trocken</Text></Text>
<Text TxtId="Clean the sieve"><Text LcId="1031">Sieb reinigen</Text></Text></Translations>
</DataType></DataTypes></TcModuleClass>"""


def test_causes_remedies_and_details_are_translated_too() -> None:
    """Each that lacks a language its class has is found on its line, also in a file whose XML is broken further down."""
    found = [(each.line, str(each).partition(": ")[2]) for each in findings(FURTHER)]
    assert found == [
        (3, "missing-language: cause 1 of event Pump.A: 'Dirt in the inlet' has no text in de-DE (1031)"),
        (5, "missing-language: detail Wiring of event Pump.A: 'Sheet 12' has no text in de-DE (1031)"),
    ]
    cut = findings(FURTHER.replace("</TcModuleClass>", "<"))
    assert [each.rule for each in cut] == ["missing-language", "missing-language", "unreadable"]


def test_a_language_that_only_a_cause_has_is_one_of_the_class() -> None:
    """Then the display text lacks it."""
    only = FURTHER.replace('<Text TxtId="Dry"><Text LcId="1031">Trocken</Text></Text>', "")
    assert findings(only)[0].message == "event Pump.A: 'Dry' has no text in de-DE (1031)"
