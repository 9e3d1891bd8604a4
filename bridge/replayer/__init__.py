"""Recordings played: onto the bus, into a book, or up to a moment."""

from bridge.replayer.fold import ReplayReport, Sink, replay_into
from bridge.replayer.player import Player, new_realm
from bridge.replayer.span import RemapError, Span, check_remap, span_of
from bridge.replayer.stage import LoggerThereError

__all__ = [
    "LoggerThereError",
    "Player",
    "RemapError",
    "ReplayReport",
    "Sink",
    "Span",
    "check_remap",
    "new_realm",
    "replay_into",
    "span_of",
]
