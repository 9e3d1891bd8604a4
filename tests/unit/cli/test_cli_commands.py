"""The command line as a whole: help, examples, documentation, exit codes."""

import json
import re
import shlex
from pathlib import Path

import pytest
from cyclopts import App
from cyclopts.argument import Argument

from bridge import config
from bridge.cli import COMMANDS, make_app, run
from bridge.cli.exits import _ERRORS, MEANING, Exit, exit_for
from bridge.core.events import Severity, Source
from bridge.edges.bus import BusConfig
from bridge.logger import EventLogger

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
README = (ROOT / "README.md").read_text(encoding="utf-8")
SHARED = {"--settings", "--show-settings", "--json"}


def command(name: str) -> App:
    """The parser of one command."""
    app = make_app()
    for part in name.split():
        app = app[part]
    return app


def help_of(name: str, capsys: pytest.CaptureFixture[str]) -> str:
    """What --help prints."""
    assert run([*name.split(), "--help"]) == Exit.OK
    return capsys.readouterr().out


def examples(text: str) -> list[str]:
    """Command lines in a text, continuations joined."""
    joined = re.sub(r"\s*\\\n\s*", " ", text)
    return [line.strip() for line in joined.splitlines() if line.strip().startswith("tcbridge ")]


def section(name: str) -> str:
    """The part of docs/commands.md about a command."""
    return PAGE.split(f"\n## {name}\n")[1].split("\n## ")[0]


def options(name: str) -> list[Argument]:
    """The parameters of a command that it does not share with all others."""
    mine = []
    for each in command(name).assemble_argument_collection():
        setting = each.names[0].removeprefix("--").replace("-", "_")
        if each.show and each.names[0] not in SHARED and not (each.names[0].startswith("--") and setting in config.HELP):
            mine.append(each)
    return mine


@pytest.mark.parametrize("name", COMMANDS)
def test_help_explains_with_an_example(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Every command has --help that ends with 0 and contains an example of that very command."""
    found = examples(help_of(name, capsys))
    assert any(line.startswith(f"tcbridge {name} ") for line in found), found


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_in_the_help_are_understood(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Each example parses."""
    for line in examples(help_of(name, capsys)):
        make_app().parse_args(shlex.split(line)[1:], exit_on_error=False, print_error=False)


def test_examples_in_the_documentation_are_understood() -> None:
    """Each command line in a block of docs/commands.md parses."""
    blocks = re.findall(r"^```sh\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in examples(block)]
    assert len(lines) >= len(COMMANDS)
    for line in lines:
        make_app().parse_args(shlex.split(line)[1:], exit_on_error=False, print_error=False)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_its_section_with_every_option(name: str) -> None:
    """docs/commands.md names each option of the command; those that all share stand in the table of settings."""
    text = section(name)
    missing = [each.names[0] for each in options(name) if each.names[0] not in text]
    assert missing == []


def test_no_section_is_about_a_command_that_does_not_exist() -> None:
    """The sections are those of the table and three shared ones."""
    titles = re.findall(r"^## (.+)$", PAGE, re.MULTILINE)
    assert sorted(titles) == sorted(["Exit codes", "Settings", "Output", *COMMANDS])


def test_every_setting_is_documented() -> None:
    """Name, option and variable of each setting stand in one row."""
    for name in config.HELP:
        (row,) = [line for line in PAGE.splitlines() if line.startswith(f"| `{name}`")]
        assert f"`{config.option(name)}`" in row
        assert f"`{config.variable(name)}`" in row


def test_the_exit_codes_of_the_documentation_are_those_of_the_program(capsys: pytest.CaptureFixture[str]) -> None:
    """One table: in the code, in the documentation, and in the help."""
    rows = re.findall(r"^\| (\d+) \| (.+) \|$", PAGE, re.MULTILINE)
    assert rows == [(str(int(code)), meaning) for code, meaning in MEANING.items()]
    assert set(MEANING) == set(Exit)
    text = help_of("", capsys)
    assert all(meaning in text for meaning in MEANING.values())


def test_the_readme_lists_the_commands() -> None:
    """Each command stands in the README's table."""
    table = "\n".join(line for line in README.splitlines() if line.startswith("| `tcbridge"))
    named = {word.removeprefix("tcbridge ") for word in re.findall(r"`([^`]+)`", table)}
    assert named == set(COMMANDS)


def test_help_of_the_program_lists_the_commands(capsys: pytest.CaptureFixture[str]) -> None:
    """In the order of the table, each with a line; hidden ones are not shown."""
    text = help_of("", capsys)
    listed = re.findall(r"^  ([a-z][a-z-]*): \S", text, re.MULTILINE)
    assert listed == list(dict.fromkeys(name.split()[0] for name in COMMANDS))


def test_wrong_usage_ends_with_2_and_a_suggestion(capsys: pytest.CaptureFixture[str]) -> None:
    """A misspelled command and a misspelled option are answered with what was probably meant."""
    assert run(["listn"]) == Exit.USAGE
    assert 'Did you mean "listen"' in capsys.readouterr().err
    assert run(["listen", "--cuont", "3"]) == Exit.USAGE
    assert "--count" in capsys.readouterr().err


def test_a_bad_filter_ends_with_2_and_a_caret(capsys: pytest.CaptureFixture[str]) -> None:
    """The place is marked, and a hint names the field that was probably meant."""
    assert run(["filter", "explain", "severity >= error and sevrity = 1"]) == Exit.USAGE
    error = capsys.readouterr().err
    assert error.splitlines() == [
        "tcbridge: unknown field 'sevrity', did you mean 'severity'?",
        "  severity >= error and sevrity = 1",
        "                        ^^^^^^^",
    ]


def test_too_many_conditions_are_wrong_usage(capsys: pytest.CaptureFixture[str]) -> None:
    """What the manual answers with an HRESULT is told with it, and ends with 2."""
    assert run(["filter", "explain", " or ".join(["event_id = 1"] * 256)]) == Exit.USAGE
    assert "ADS_E_NOMOREHDL" in capsys.readouterr().err


def test_filter_explain_prints_every_part(capsys: pytest.CaptureFixture[str]) -> None:
    """Tree, keys, predicate and SQL, with what is exact."""
    assert run(["filter", "explain", "--realm", "r 1", "severity = error and event_id = 7"]) == Exit.OK
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines if not line.startswith(" ")] == ["filter", "tree", "keys", "predicate", "SQL"]
    assert "  tc3/1/r%201/*/event/*/*/error" in lines


def test_show_settings_does_nothing_else(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """--show-settings prints each setting with its origin and opens nothing, not even a bad filter."""
    monkeypatch.setenv("TCBRIDGE_REALM", "r2")
    assert run(["listen", "--show-settings", "--target", "t1", "--filter", "nonsense !"]) == Exit.OK
    rows = {line.split()[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines()}
    assert rows["target"] == ["t1", "option", "--target"]
    assert rows["realm"] == ["r2", "environment", "TCBRIDGE_REALM"]
    assert set(rows) == {"Setting", *config.HELP}


def test_a_bad_setting_ends_with_2(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """A misspelled variable is refused by every command."""
    monkeypatch.setenv("TCBRIDGE_TRAGET", "x")
    assert run(["listen"]) == Exit.USAGE
    assert "TCBRIDGE_TARGET" in capsys.readouterr().err


def test_a_fault_of_ours_keeps_its_traceback(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """An error that no user can cause is shown whole and ends with 70."""
    monkeypatch.setattr("bridge.core.filters.explain.explain", None)
    assert run(["filter", "explain", "is_alarm"]) == Exit.BUG
    assert "Traceback" in capsys.readouterr().err


def test_errors_that_have_an_exit_code_exist() -> None:
    """Each name in the table is a class of this package or of Python, so that a renamed error is noticed."""
    sources = "\n".join(path.read_text(encoding="utf-8") for path in (ROOT / "bridge").rglob("*.py"))
    missing = [name for name in _ERRORS if name != "OSError" and f"class {name}(" not in sources]
    assert missing == []


def test_an_error_is_found_by_its_bases_too() -> None:
    """FileNotFoundError is an OSError; a KeyError has no code, it is a fault of ours."""
    assert exit_for(FileNotFoundError()) is Exit.NO
    assert exit_for(KeyError()) is None


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_speaks_json(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """--json is there for programs."""
    assert "--json" in help_of(name, capsys)


def test_a_plant_that_is_not_there_is_said_as_elsewhere(capsys: pytest.CaptureFixture[str]) -> None:
    """As wrong usage, in the words of the other commands."""
    assert run(["run", "gone.toml"]) == Exit.USAGE
    assert capsys.readouterr().err == "tcbridge: gone.toml: no such file\n"


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("clear", "name CLASS and EVENT, or --all"),
        ("confirm Faults", "name CLASS and EVENT, or --all"),
        ("clear Faults 1 --filter is_raised", "--filter needs --all"),
        ("confirm Faults 1 --all", "choose some with --filter"),
        ("clear --all --source-name MAIN", "choose some with --filter"),
        ("clear --all --arg 1", "choose some with --filter"),
    ],
)
def test_one_alarm_or_all_of_them(line: str, expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    """What stands for one alarm and --all exclude each other, and one of them is needed."""
    assert run(line.split()) == Exit.USAGE
    assert expected in capsys.readouterr().err


def test_all_alarms_are_confirmed_and_cleared_from_the_command_line(
    bus_config: BusConfig, capsys: pytest.CaptureFixture[str]
) -> None:
    """Those of the filter, or all; each is printed as it is then, how many on stderr, and who and why are kept."""
    guid = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
    where = ["--scouting-group", bus_config.scouting_group, "--json"]
    with EventLogger("local", config=bus_config) as logger:
        for number in (1, 2, 3):
            source = Source(name=f"MAIN.axis{number}")
            logger.raise_alarm(logger.create_alarm(guid, number, Severity.ERROR, with_confirmation=True, source=source).alarm)
        assert run(["confirm", "--all", "--filter", "event_id > 1", "--operator", "anna", *where]) == Exit.OK
        printed = capsys.readouterr()
        alarms = [json.loads(each) for each in printed.out.splitlines()]
        assert [(each["event_id"], each["confirmation_state"], each["operator"]) for each in alarms] == [
            (2, 3, "anna"),
            (3, 3, "anna"),
        ]
        assert "2 alarms confirmed" in printed.err
        assert run(["clear", "--all", "--reset-confirmation", "--comment", "over", *where]) == Exit.OK
        assert len(capsys.readouterr().out.splitlines()) == 3
        assert logger.active_alarms() == []
        assert run(["clear", "--all", *where]) == Exit.OK
        assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("sink syslog", "the sink is off: say --syslog-types messages, alarms or both"),
        ("sink syslog --syslog-types both --syslog-address log-host:", "--syslog-address: 'log-host:' is no address"),
        ("sink syslog --syslog-types both --facility plant", "no facility 'plant'; one of"),
        ("sink syslog --syslog-types all", "--syslog-types"),
    ],
)
def test_what_the_system_log_sink_refuses(
    line: str, expected: str, capsys: pytest.CaptureFixture[str], bus_config: BusConfig
) -> None:
    """It is off by default, and what it cannot use is named."""
    assert run([*line.split(), "--scouting-group", bus_config.scouting_group]) == Exit.USAGE
    assert expected in capsys.readouterr().err


def test_config_show_says_where_each_value_came_from(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Default, file, environment and option, for every setting; what is misspelled is refused with the nearest name."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TCBRIDGE_LANG", "de")
    (tmp_path / "tcbridge.toml").write_text('realm = "plant"\nsyslog_types = "alarms"\n')
    assert run(["config", "show", "--target", "t1", "--json"]) == Exit.OK
    rows = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [row["setting"] for row in rows] == list(config.HELP)
    origins = {row["setting"]: (row["value"], row["origin"]) for row in rows if row["origin"] != "default"}
    assert origins == {
        "target": ("t1", "option --target"),
        "realm": ("plant", "file tcbridge.toml"),
        "lang": ("de", "environment TCBRIDGE_LANG"),
        "syslog_types": ("alarms", "file tcbridge.toml"),
    }
    (tmp_path / "tcbridge.toml").write_text('syslog_tipes = "alarms"\n')
    assert run(["config", "show"]) == Exit.USAGE
    assert capsys.readouterr().err == "tcbridge: tcbridge.toml: no such setting: syslog_tipes, did you mean syslog_types?\n"
    (tmp_path / "tcbridge.toml").write_text('syslog_types = "alarm"\n')
    assert run(["config", "show"]) == Exit.USAGE
    assert "tcbridge.toml: " in capsys.readouterr().err
