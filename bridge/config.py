"""Which settings there are, and where each value came from.

Rule 1: an option beats the environment, the environment beats the file, the file beats the default; per setting.
Rule 2: one spelling. A setting `scouting_group` is the option --scouting-group, the variable TCBRIDGE_SCOUTING_GROUP and the
key scouting_group of the file.
Rule 3: nothing is read at import. Options and environment come in as data; only load() opens a file.
Rule 4: what is misspelled is an error, not a silence: unknown keys and unknown TCBRIDGE_ variables are refused.

The file is TOML: that of --settings or TCBRIDGE_SETTINGS, else tcbridge.toml in the working folder if there is one. Relative
paths in it start at its folder. An empty variable counts as not set.
"""

import difflib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal, TypeAlias

import msgspec

from bridge.core import codec
from bridge.core.catalog import language_id

FILE_NAME: Final = "tcbridge.toml"
VARIABLE_PREFIX: Final = "TCBRIDGE_"
FILE_VARIABLE: Final = "TCBRIDGE_SETTINGS"
DEFAULT_TARGET: Final = "local"
"""The target of a command that needs one when no setting names it."""

EncodingName: TypeAlias = Literal["json", "msgpack"]
SystemErrors: TypeAlias = Literal["none", "own", "host"]
SyslogTypes: TypeAlias = Literal["none", "messages", "alarms", "both"]
SeverityName: TypeAlias = Literal["verbose", "info", "warning", "error", "critical"]
ModulesAccess: TypeAlias = Literal["none", "read", "call", "all"]
_ENCODINGS: Final[dict[EncodingName, codec.Encoding]] = {"json": codec.JSON, "msgpack": codec.MSGPACK}


class Settings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What all programs share. HELP has a line for each."""

    target: str = ""
    realm: str = "live"
    lang: str = "en"
    classes: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    lan: bool = False
    scouting_group: str = "224.0.0.224:7446"
    config: str = ""
    encoding: EncodingName = "json"
    operator: str = ""
    cache: str = ""
    max_size: int = 20_000_000
    max_events: int = 0
    max_age: float = 0.0
    durable: bool = False
    system_errors: SystemErrors = "none"
    syslog_types: SyslogTypes = "none"
    syslog_severity: SeverityName = "verbose"
    syslog_address: str = "/dev/log"
    modules_access: ModulesAccess = "all"

    @property
    def one_target(self) -> str:
        """The target, for commands that need exactly one."""
        return self.target or DEFAULT_TARGET

    @property
    def wire_encoding(self) -> codec.Encoding:
        """The encoding as the codec calls it."""
        return _ENCODINGS[self.encoding]


HELP: Final = {
    "target": f"Name of the logger on the bus. Not set: every target for readers, {DEFAULT_TARGET!r} for the others.",
    "realm": "The world: live, or that of a replay.",
    "lang": "Language of texts: a tag (de, de-DE) or an LCID (1031).",
    "classes": "Files or folders with event classes (.tmc, .tsproj, .xti).",
    "connect": "Zenoh endpoint to connect to, e.g. tcp/10.0.0.5:7447.",
    "listen": "Zenoh endpoint to listen on, e.g. tcp/0.0.0.0:7447.",
    "lan": "Listen on and scout the network, not only this machine.",
    "scouting_group": "Multicast group in which programs find each other.",
    "config": "Zenoh configuration file, taken as it is.",
    "encoding": "What publishers send: json or msgpack. Every reader takes both.",
    "operator": "Who raises, clears, confirms. Not set: the name of the user.",
    "cache": "SQLite file that keeps a logger's log. Not set: memory.",
    "max_size": "Bytes of the log; half goes when it is full.",
    "max_events": "Events of the log; half goes when there are more. 0: no limit.",
    "max_age": "Seconds that an event stays in the log. 0: no limit.",
    "durable": "Answer commands only when they are safe from a power cut.",
    "system_errors": "Errors that become events: none, own (of the logger's program) or host (and the machine's).",
    "syslog_types": "What goes into the system's log: none, messages, alarms or both.",
    "syslog_severity": "The lowest severity that goes into the system's log.",
    "syslog_address": "Where the system's log is: a path, or HOST:PORT (UDP).",
    "modules_access": "What others may do with a plant's modules: none, read, call (and set values), all (and change states).",
}
"""One line per setting, for the help, the documentation and the tests."""

_PATHS: Final = ("classes", "config", "cache")
_SEPARATORS: Final = {"classes": os.pathsep, "connect": ",", "listen": ","}
"""How a variable holds several values."""


class SettingsError(ValueError):
    """A setting that cannot be used: where it was read, and what was expected."""

    def __init__(self, where: str, message: str) -> None:
        self.where, self.message = where, message
        super().__init__(f"{where}: {message}")


class Loaded(msgspec.Struct, frozen=True):
    """The settings, and for each what gave it its value: "default", "file ...", "environment ..." or "option ..."."""

    settings: Settings
    origins: dict[str, str]

    def rows(self) -> list[tuple[str, str, str]]:
        """(name, value, origin) per setting, for people."""
        return [(name, _shown(getattr(self.settings, name)), self.origins[name]) for name in HELP]


def load(
    options: Mapping[str, object],
    environ: Mapping[str, str],
    file: str | Path | None = None,
    *,
    table: Mapping[str, object] | None = None,
) -> Loaded:
    """Put the layers together. An option that is None was not given; `file` is that of --settings.

    table: settings that somebody has read from the file already, e.g. those of a plant; no other file is read then.
    SettingsError names the place and what was expected, also for a file that was asked for and cannot be read.
    """
    values: dict[str, object] = {}
    origins = dict.fromkeys(HELP, "default")
    path, asked_by = _file(environ, file)
    if table is not None and file is not None:
        _add(values, origins, _beside(Path(file), dict(table)), dict.fromkeys(HELP, f"file {file}"))
    elif path is not None:
        _add(values, origins, _from_file(path, asked_by), dict.fromkeys(HELP, f"file {path}"))
    _add(values, origins, _from_environ(environ), {name: f"environment {variable(name)}" for name in HELP})
    given = {name: value for name, value in options.items() if value is not None and value != ()}
    _add(values, origins, given, {name: f"option {option(name)}" for name in HELP})
    for name, value in values.items():
        check(name, value, origins[name])
    return Loaded(msgspec.convert(values, Settings, strict=False), origins)


def variable(name: str) -> str:
    """The environment variable of a setting."""
    return f"{VARIABLE_PREFIX}{name.upper()}"


def option(name: str) -> str:
    """The command-line option of a setting."""
    return f"--{name.replace('_', '-')}"


def _add(values: dict[str, object], origins: dict[str, str], layer: Mapping[str, object], names: Mapping[str, str]) -> None:
    for name, value in layer.items():
        values[name] = value
        origins[name] = names[name]


def _file(environ: Mapping[str, str], given: str | Path | None) -> tuple[Path | None, str]:
    if given is not None:
        return Path(given), "option --settings"
    if named := environ.get(FILE_VARIABLE):
        return Path(named), f"environment {FILE_VARIABLE}"
    return (Path(FILE_NAME), "") if Path(FILE_NAME).is_file() else (None, "")


def _from_file(path: Path, asked_by: str) -> dict[str, object]:
    try:
        data = path.read_bytes()
        msgspec.toml.decode(data, type=Settings)
        found: dict[str, object] = msgspec.toml.decode(data)
    except OSError as error:
        raise SettingsError(asked_by or str(path), f"{path}: {error.strerror or error}") from None
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise SettingsError(str(path), _explained(str(error))) from None
    return _beside(path, found)


def _beside(path: Path, found: dict[str, object]) -> dict[str, object]:
    """Paths in a file start at its folder."""
    for name in _PATHS:
        if isinstance(given := found.get(name), str):
            found[name] = str(path.parent / given)
        elif isinstance(given, list):
            found[name] = tuple(str(path.parent / each) for each in given)
    return found


def _from_environ(environ: Mapping[str, str]) -> dict[str, object]:
    found: dict[str, object] = {}
    for key, text in environ.items():
        if not key.startswith(VARIABLE_PREFIX) or key == FILE_VARIABLE:
            continue
        name = key.removeprefix(VARIABLE_PREFIX).lower()
        if name not in HELP or key != variable(name):
            raise SettingsError(f"environment {key}", f"no such setting{_nearest(key, [variable(each) for each in HELP])}")
        if not text:
            continue
        separator = _SEPARATORS.get(name)
        found[name] = tuple(part for part in text.split(separator) if part) if separator else text
    return found


def check(name: str, value: object, origin: str) -> None:
    """SettingsError for a value that the setting does not take, and for a setting that is none."""
    try:
        msgspec.convert({name: value}, Settings, strict=False)
        if name == "lang":
            language_id(str(value))
    except (msgspec.ValidationError, ValueError) as error:
        raise SettingsError(origin, _explained(str(error))) from None


def _explained(message: str) -> str:
    unknown = message.partition("unknown field `")[2].partition("`")[0]
    if unknown:
        return f"no such setting: {unknown}{_nearest(unknown, list(HELP))}"
    return (
        message.partition(" - at `")[0].replace("`bool`", "true or false").replace("`str`", "text").replace("`array`", "a list")
    )


def _nearest(word: str, words: list[str]) -> str:
    near = difflib.get_close_matches(word, words, 1)
    return f", did you mean {near[0]}?" if near else ""


def _shown(value: object) -> str:
    match value:
        case bool():
            return "yes" if value else "no"
        case tuple():
            return ", ".join(map(str, value))
        case _:
            return str(value)
