"""The command `tcbridge`: which sub-commands there are, and how a program ends.

Rule 1: one module per command; it is imported when its command runs, and so is everything heavy.
Rule 2: commands return an exit code and raise what went wrong; main() turns errors into one line on stderr and a code of
exits.py. A traceback means a fault of ours.
"""

import os
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Final, Literal

from cyclopts import App, CycloptsError, Parameter

from bridge.cli.exits import MEANING, Exit, exit_for
from bridge.cli.signals import Interrupted, clean_end

COMMANDS: Final = {
    "run": "bridge.cli.run:run",
    "serve": "bridge.cli.serve:serve",
    "send": "bridge.cli.send:send",
    "create": "bridge.cli.command:create",
    "raise": "bridge.cli.command:raise_",
    "clear": "bridge.cli.command:clear",
    "confirm": "bridge.cli.command:confirm",
    "dispose": "bridge.cli.command:dispose",
    "alarms": "bridge.cli.alarms:alarms",
    "log": "bridge.cli.log:log",
    "log export": "bridge.cli.log_export:export",
    "log import": "bridge.cli.log_import:import_",
    "log clear": "bridge.cli.log_clear:clear",
    "listen": "bridge.cli.listen:listen",
    "record": "bridge.cli.record:record",
    "replay": "bridge.cli.replay:replay",
    "control": "bridge.cli.control:control",
    "info": "bridge.cli.info:info",
    "cat": "bridge.cli.cat:cat",
    "cut": "bridge.cli.cut:cut",
    "merge": "bridge.cli.cut:merge",
    "diff": "bridge.cli.diff:diff",
    "export": "bridge.cli.export:export",
    "recover": "bridge.cli.recover:recover",
    "doctor": "bridge.cli.doctor:doctor",
    "convert": "bridge.cli.convert:convert",
    "filter explain": "bridge.cli.filter:explain",
    "classes list": "bridge.cli.classes:class_list",
    "classes show": "bridge.cli.classes:show",
    "classes lint": "bridge.cli.classes:lint",
    "classes diff": "bridge.cli.classes:diff",
    "classes new": "bridge.cli.classes_write:new",
    "classes convert": "bridge.cli.classes_write:convert",
    "classes generate": "bridge.cli.classes_write:generate",
    "classes translations export": "bridge.cli.classes_write:translations_export",
    "classes translations import": "bridge.cli.classes_write:translations_import",
    "classes delete-unused": "bridge.cli.classes_write:delete_unused",
    "classes where-used": "bridge.cli.where_used:where_used",
    "modules list": "bridge.cli.modules:list_",
    "modules show": "bridge.cli.modules:show",
    "modules state": "bridge.cli.modules:state",
    "modules param": "bridge.cli.modules:param",
    "modules call": "bridge.cli.modules:call",
    "modules describe": "bridge.cli.modules_describe:describe",
    "error": "bridge.cli.error:error",
    "sink syslog": "bridge.cli.sink:syslog",
    "config show": "bridge.cli.config:show",
    "router": "bridge.cli.router:router",
    "demo": "bridge.cli.demo:demo",
}
"""Every command and where it is; the help, README, docs/commands.md and the tests follow this table."""
_GROUPS: Final = {
    "filter": "Work with filters.",
    "sink": "Events out to what is no program of ours.",
    "config": "Work with settings.",
    "classes": "Work with event classes and their texts.",
    "classes translations": "Texts out to translators, and back.",
    "modules": "Work with modules.",
}
_HIDDEN: Final = {"demo-publisher": "bridge.cli.demo_plant:publisher"}


def program_version() -> str:
    """The version of the installed package."""
    try:
        return version("tcbridge")
    except PackageNotFoundError:
        return "unknown"


def make_app(*, lazy: bool = False) -> App:
    """The parser of the command line. When lazy, it knows its commands by name only, which is enough to run one."""
    codes = "\n".join(f"{code:>5}  {meaning}" for code, meaning in MEANING.items())
    formatter: Literal["default", "plain"] = "default" if sys.stdout.isatty() else "plain"
    app = App(
        name="tcbridge",
        help="Events and alarms in the manner of the TwinCAT 3 EventLogger, on a Zenoh bus.",
        help_epilogue=f"Every command has --help with an example.\n\nExit codes:\n\n{codes}",
        help_format="plaintext",
        help_formatter=formatter,
        error_formatter=_usage,
        version=program_version,
        result_action="return_value",
        suppress_keyboard_interrupt=False,
        default_parameter=Parameter(show_default=False, negative=()),
    )
    groups = {name: App(name=name.split()[-1], help=text, help_epilogue="") for name, text in _GROUPS.items()}
    for number, (name, place) in enumerate((COMMANDS | _HIDDEN).items()):
        group, _, last = name.rpartition(" ")
        if any(other.startswith(f"{name} ") for other in COMMANDS):  # a command, and the group of others
            groups[name] = App(name=last, help_epilogue="", sort_key=number)
            groups[name].default(_function(place))
            continue
        owner = groups[group] if group else app
        command = place if lazy or name in _HIDDEN else _function(place)
        owner.command(command, name=last, show=name not in _HIDDEN, sort_key=number, help_epilogue="")
        if group and groups[group].sort_key is None:
            groups[group].sort_key = number
    for name, each in groups.items():
        above = name.rpartition(" ")[0]
        (groups[above] if above else app).command(each)
    return app


def _function(place: str) -> Callable[..., int]:
    module, _, name = place.partition(":")
    found: Callable[..., int] = getattr(import_module(module), name)
    return found


def _usage(error: CycloptsError) -> str:
    return f"tcbridge: {error}"


def run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code."""
    try:
        with clean_end():
            lazy = any(list(arguments[: len(name.split())]) == name.split() for name in COMMANDS)
            result = make_app(lazy=lazy)(arguments, exit_on_error=False, print_error=True)
            return result if isinstance(result, int) else Exit.OK
    except CycloptsError:
        return Exit.USAGE
    except Interrupted as interrupted:
        return interrupted.code
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else Exit.OK
    except BrokenPipeError:
        with suppress(OSError):  # what is left in the buffer has nowhere to go
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return Exit.PIPE
    except Exception as error:  # noqa: BLE001  # each becomes a code; a fault of ours keeps its traceback
        code = exit_for(error)
        if code is None:
            sys.excepthook(type(error), error, error.__traceback__)
            return Exit.BUG
        print(f"tcbridge: {error}", file=sys.stderr)
        return code


def main() -> None:
    """The entry point."""
    code = run(sys.argv[1:])
    with suppress(BrokenPipeError):
        sys.stdout.flush()
    sys.exit(code)
