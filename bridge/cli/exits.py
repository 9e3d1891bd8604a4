"""What a command's exit code means: one table, read by the commands, the help, docs/commands.md and the tests.

Rule 1: 0 says that what was asked for was done and nothing was lost. Commands that run until they are stopped (serve, sink,
router, listen, record, alarms --watch) end so with 0; the others end a signal with 130 or 143, for their work was not done.
Rule 2: errors are found by the name of their class, so that no command imports what it does not use.
"""

from enum import IntEnum
from typing import Final


class Exit(IntEnum):
    """The exit codes."""

    OK = 0
    NO = 1
    USAGE = 2
    LOST = 3
    UNKNOWN = 4
    BUG = 70
    INTERRUPTED = 130
    PIPE = 141
    TERMINATED = 143


MEANING: Final[dict[Exit, str]] = {
    Exit.OK: "done, and nothing was lost",
    Exit.NO: "no: refused, different, not complete, file not usable",
    Exit.USAGE: "wrong usage: an option, a setting, a filter or a name",
    Exit.LOST: "something was not sent or was lost; what and how much is said",
    Exit.UNKNOWN: "nobody answers; what became of a command is unknown",
    Exit.BUG: "a fault of tcbridge; the traceback says where",
    Exit.INTERRUPTED: "stopped by Ctrl-C (SIGINT) before the work was done",
    Exit.PIPE: "whoever read the output is gone",
    Exit.TERMINATED: "stopped by SIGTERM before the work was done",
}

_ERRORS: Final[dict[str, Exit]] = {
    "Usage": Exit.USAGE,
    "SettingsError": Exit.USAGE,
    "FilterSyntaxError": Exit.USAGE,
    "UnknownClassError": Exit.USAGE,
    "ClassNameError": Exit.USAGE,
    "CodeNameError": Exit.USAGE,
    "KeyFormatError": Exit.USAGE,
    "ArgumentError": Exit.USAGE,
    "LimitError": Exit.USAGE,
    "TimeError": Exit.USAGE,
    "RemapError": Exit.USAGE,
    "PlantError": Exit.USAGE,
    "IdError": Exit.USAGE,
    "AdsError": Exit.NO,
    "CacheError": Exit.NO,
    "LanguageError": Exit.USAGE,
    "RecordingError": Exit.NO,
    "TargetTakenError": Exit.NO,
    "TwoLoggersError": Exit.NO,
    "NotFreshError": Exit.NO,
    "NameTakenError": Exit.NO,
    "ObjectsTakenError": Exit.NO,
    "LoggerThereError": Exit.NO,
    "DemoError": Exit.NO,
    "JournalError": Exit.NO,
    "QueueFullError": Exit.LOST,
    "BusError": Exit.UNKNOWN,
    "NoLoggerError": Exit.UNKNOWN,
    "NobodyError": Exit.UNKNOWN,
    "CommandUnknownError": Exit.UNKNOWN,
    "OSError": Exit.NO,
}


class Usage(ValueError):
    """Wrong usage that the parser of options cannot see."""


def exit_for(error: BaseException) -> Exit | None:
    """The exit code of an error that a user can cause; None for a fault of ours."""
    for kind in type(error).__mro__:
        if kind.__name__ in _ERRORS:
            return _ERRORS[kind.__name__]
    return None
