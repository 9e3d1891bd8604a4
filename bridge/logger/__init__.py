"""The EventLogger, from inside and from outside, and who follows it."""

from bridge.logger.book import Book, NotFreshError
from bridge.logger.commands import Commands
from bridge.logger.mirror import Mirror, MirrorCounters
from bridge.logger.proxy import CommandUnknownError, LoggerProxy, NoLoggerError
from bridge.logger.service import EventLogger, LoggerCounters, TargetTakenError

__all__ = [
    "Book",
    "CommandUnknownError",
    "Commands",
    "EventLogger",
    "LoggerCounters",
    "LoggerProxy",
    "Mirror",
    "MirrorCounters",
    "NoLoggerError",
    "NotFreshError",
    "TargetTakenError",
]
