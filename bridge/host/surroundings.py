"""What the modules of ours need of the program they run in: the bus, the settings, the folder, the loggers that are in OP."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

from bridge.config import Settings
from bridge.core.catalog import Catalog
from bridge.edges.bus import Bus
from bridge.logger import EventLogger

FLUSH_S: Final = 0.3


class Surroundings:
    """One per program."""

    def __init__(
        self,
        bus: Bus,
        settings: Settings,
        catalog: Catalog,
        *,
        folder: Path = Path(),
        plant: Path | None = None,
        told: Callable[[str], None] = lambda _: None,
    ) -> None:
        """folder: where relative paths of the plant start; plant: its file; told hears what a person should know."""
        self.bus, self.settings, self.catalog, self.told = bus, settings, catalog, told
        self.folder, self.plant = folder, plant
        self.lost = 0
        """Events that closing could not send or write."""
        self._loggers: dict[str, EventLogger] = {}
        self._lock = threading.Lock()
        self.on_logger: Callable[[], None] = lambda: None
        """Called when a logger has come to OP."""

    def logger(self) -> EventLogger | None:
        """The logger in OP that the plant's own events go to: that of the settings' target, else the first."""
        with self._lock:
            return self._loggers.get(self.settings.one_target) or next(iter(self._loggers.values()), None)

    def logger_is_up(self, logger: EventLogger) -> None:
        """A logger has come to OP."""
        with self._lock:
            self._loggers[logger.target] = logger
        self.on_logger()

    def logger_is_down(self, logger: EventLogger) -> None:
        """It has left OP."""
        with self._lock:
            self._loggers.pop(logger.target, None)

    def flush(self) -> None:
        """Wait until what the loggers have sent is on the bus: whoever listens is about to end."""
        with self._lock:
            loggers = list(self._loggers.values())
        for logger in loggers:
            logger.publisher.flush(FLUSH_S)
