"""The cache of logged events: SQLite on disk or in memory."""

from bridge.edges.cache.file import CacheError, move_aside
from bridge.edges.cache.queries import SessionRange
from bridge.edges.cache.rows import RowError, StoreBatch, Stored, StoredAlarm, StoredAnswer, StoredEvent
from bridge.edges.cache.store import Cache, CacheCounts, Drop

__all__ = [
    "Cache",
    "CacheCounts",
    "CacheError",
    "Drop",
    "RowError",
    "SessionRange",
    "StoreBatch",
    "Stored",
    "StoredAlarm",
    "StoredAnswer",
    "StoredEvent",
    "move_aside",
]
