"""Settings: which layer counts, and what is refused."""

from pathlib import Path

import pytest

from bridge.config import HELP, Settings, SettingsError, load, option, variable
from bridge.core import codec


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder, so that no settings file is found by chance."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_setting_has_a_help_line_and_no_help_line_is_without_a_setting() -> None:
    """HELP follows the struct, in its order."""
    assert tuple(HELP) == Settings.__struct_fields__


def test_without_anything_all_settings_are_defaults() -> None:
    """Nothing given: the defaults, and each says so."""
    loaded = load({}, {})
    assert loaded.settings == Settings()
    assert set(loaded.origins.values()) == {"default"}


def test_an_option_beats_the_environment_which_beats_the_file(folder: Path) -> None:
    """Per setting the strongest layer that names it counts, and it is named."""
    (folder / "tcbridge.toml").write_text('target = "file"\nrealm = "file"\nlang = "de"\n')
    loaded = load({"target": "option"}, {"TCBRIDGE_TARGET": "environment", "TCBRIDGE_REALM": "environment"})
    assert (loaded.settings.target, loaded.settings.realm, loaded.settings.lang) == ("option", "environment", "de")
    assert [loaded.origins[name] for name in ("target", "realm", "lang", "lan")] == [
        "option --target",
        "environment TCBRIDGE_REALM",
        "file tcbridge.toml",
        "default",
    ]


@pytest.mark.parametrize("given", [None, ()])
def test_an_option_that_was_not_given_says_nothing(given: object) -> None:
    """None and an empty list are what the parser hands over for an option that was not typed."""
    loaded = load({"classes": given}, {"TCBRIDGE_CLASSES": "a"})
    assert loaded.settings.classes == ("a",)


def test_a_variable_holds_texts_lists_and_truth() -> None:
    """Endpoints are separated by commas, paths as in PATH, truth is written true or false, and an empty one is not set."""
    environ = {"TCBRIDGE_CONNECT": "tcp/a:1,tcp/b:2", "TCBRIDGE_CLASSES": "x:y", "TCBRIDGE_LAN": "true", "TCBRIDGE_REALM": ""}
    settings = load({}, environ).settings
    assert settings.connect == ("tcp/a:1", "tcp/b:2")
    assert settings.classes == ("x", "y")
    assert settings.lan is True
    assert settings.realm == "live"


def test_other_variables_are_nobodys_business() -> None:
    """Only TCBRIDGE_ variables are read."""
    assert load({}, {"PATH": "x", "LANG": "de_DE.UTF-8"}).settings == Settings()


def test_an_option_can_take_back_what_a_variable_says() -> None:
    """--no-lan beats TCBRIDGE_LAN=true."""
    loaded = load({"lan": False}, {"TCBRIDGE_LAN": "true"})
    assert (loaded.settings.lan, loaded.origins["lan"]) == (False, "option --lan")


def test_paths_in_a_file_start_at_its_folder(folder: Path) -> None:
    """A settings file elsewhere names class files beside it; an absolute path stays."""
    (folder / "etc").mkdir()
    (folder / "etc" / "my.toml").write_text('classes = ["plant.tmc", "/abs.tmc"]\nconfig = "zenoh.json5"\n')
    settings = load({}, {}, "etc/my.toml").settings
    assert settings.classes == ("etc/plant.tmc", "/abs.tmc")
    assert settings.config == "etc/zenoh.json5"


def test_the_file_can_be_named_by_a_variable(folder: Path) -> None:
    """TCBRIDGE_SETTINGS names the file; --settings is stronger."""
    (folder / "a.toml").write_text('target = "a"')
    (folder / "b.toml").write_text('target = "b"')
    environ = {"TCBRIDGE_SETTINGS": "a.toml"}
    assert load({}, environ).settings.target == "a"
    assert load({}, environ, "b.toml").settings.target == "b"


REFUSED = [
    ({"TCBRIDGE_TRAGET": "x"}, "", "environment TCBRIDGE_TRAGET: no such setting, did you mean TCBRIDGE_TARGET?"),
    ({"TCBRIDGE_LAN": "perhaps"}, "", "environment TCBRIDGE_LAN: Expected true or false"),
    ({"TCBRIDGE_LANG": "xx"}, "", "environment TCBRIDGE_LANG: unknown language 'xx'"),
    ({"TCBRIDGE_ENCODING": "xml"}, "", "environment TCBRIDGE_ENCODING: Invalid enum value 'xml'"),
    ({"TCBRIDGE_SETTINGS": "gone.toml"}, "", "environment TCBRIDGE_SETTINGS: gone.toml: No such file"),
    ({}, 'tragt = "x"', "tcbridge.toml: no such setting: tragt, did you mean target?"),
    ({}, "target = 3", "tcbridge.toml: Expected text, got `int`"),
    ({}, 'lan = "true"', "tcbridge.toml: Expected true or false, got text"),
    ({}, 'lang = "klingon"', "file tcbridge.toml: unknown language 'klingon'"),
    ({}, "target", "tcbridge.toml: Expected '=' after a key"),
]


@pytest.mark.parametrize(("environ", "file", "message"), REFUSED)
def test_what_is_misspelled_is_refused_and_its_place_is_named(
    folder: Path, environ: dict[str, str], file: str, message: str
) -> None:
    """The error says where the setting was read and what was expected."""
    if file:
        (folder / "tcbridge.toml").write_text(file)
    with pytest.raises(SettingsError) as caught:
        load({}, environ)
    assert str(caught.value).startswith(message)


def test_a_file_that_was_asked_for_must_be_there() -> None:
    """--settings with a file that does not exist is an error, not a silence."""
    with pytest.raises(SettingsError, match=r"option --settings: gone\.toml: No such file"):
        load({}, {}, "gone.toml")


def test_rows_show_each_setting_with_its_origin() -> None:
    """For people: name, value as text, origin."""
    rows = {row[0]: row[1:] for row in load({"classes": ("a", "b"), "lan": True}, {}).rows()}
    assert rows["classes"] == ("a, b", "option --classes")
    assert rows["lan"] == ("yes", "option --lan")
    assert rows["config"] == ("", "default")


def test_a_command_that_needs_one_target_has_one() -> None:
    """Without a target it is "local"."""
    assert Settings().one_target == "local"
    assert Settings(target="plc1").one_target == "plc1"


def test_names_of_encodings_are_those_of_the_codec() -> None:
    """json and msgpack stand for the encodings of the wire."""
    assert Settings().wire_encoding == codec.JSON
    assert Settings(encoding="msgpack").wire_encoding == codec.MSGPACK


def test_one_spelling_in_every_layer() -> None:
    """scouting_group is --scouting-group and TCBRIDGE_SCOUTING_GROUP."""
    assert (option("scouting_group"), variable("scouting_group")) == ("--scouting-group", "TCBRIDGE_SCOUTING_GROUP")
