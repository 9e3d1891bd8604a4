"""What has changed in an object, here or on another machine: its values, read again and again.

    with server.get(object_id, IWatchSource) as source, Sampler(source, ["outputs.total", "gain"], told):
        ...

Rule 1: the values of one sample are of one moment. Each is told at first and when it is another one than in the last sample;
what changes back in between is not seen. (ObjectServer.watch sees each change, in its own process only.)
Rule 2: an object that cannot be read is told once, as the error, until it can be read again; then what has changed is told.
Rule 3: one thread per sampler, which ends with it. What `told` raises is logged and ends nothing.
"""

import logging
import threading
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Final, Self

from bridge.core.hresult import AdsError
from bridge.tccom.declarations import UNSET
from bridge.tccom.general import IWatchSource, ParameterKey
from bridge.tccom.values import same

log: Final = logging.getLogger(__name__)

JOIN_S: Final = 2.0


class Sampler:
    """Tells changes of parameters and symbols. A context manager."""

    def __init__(
        self,
        source: IWatchSource,
        keys: Sequence[ParameterKey],
        told: Callable[[ParameterKey, object], None],
        *,
        failed: Callable[[AdsError], None] = lambda _: None,
        every_s: float = 0.1,
    ) -> None:
        """told gets the key and its value, failed why there is none; both are called on the sampler's thread."""
        self._source, self._keys, self._told, self._failed, self._every_s = source, tuple(keys), told, failed, every_s
        self._last: tuple[object, ...] = (UNSET,) * len(self._keys)
        self._failing = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="sampler", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End it: nothing more is told. Any number of times."""
        self._stop.set()
        if self._thread is not threading.current_thread():
            self._thread.join(JOIN_S)

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                self._sample()
            except Exception:
                log.exception("what was told of a sample could not be taken")
            self._stop.wait(self._every_s)

    def _sample(self) -> None:
        try:
            now = self._source.read_values(self._keys).value
        except AdsError as error:
            if not self._failing and not self._stop.is_set():
                self._failing = True
                self._failed(error)
            return
        self._failing = False
        last, self._last = self._last, now
        for key, before, value in zip(self._keys, last, now, strict=True):
            if not same(before, value) and not self._stop.is_set():
                self._told(key, value)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        self.close()
