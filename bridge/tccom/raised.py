"""What becomes of an exception that an author's code raises: an AdsError for whoever asked, and a traceback for the author.

Rule 1: an AdsError is an answer. It is passed on as it is, and not logged.
Rule 2: anything else is ADS_E_EXCEPTION. The answer names the innermost line of the author's code; the log has the traceback.
Rule 3: the same place is logged once in QUIET_S: a method may be called a thousand times a second.
"""

import logging
import sys
import threading
import time
import traceback
from pathlib import Path
from typing import Final

from bridge.core.hresult import ADS_E_EXCEPTION, AdsError

log: Final = logging.getLogger(__name__)

QUIET_S: Final = 60.0
_OURS: Final = __name__.partition(".")[0]
_logged: Final[dict[tuple[type[BaseException], str, str], float]] = {}
_lock: Final = threading.Lock()


def as_ads_error(error: BaseException, doing: str = "") -> AdsError:
    """The answer for whoever asked, which begins with what was being done; what nobody foresaw is logged."""
    if isinstance(error, AdsError):
        return error
    place = _place(error)
    first, newline, rest = str(error).partition("\n")
    detail = f"{type(error).__name__}: {first}{place and f' ({place})'}{newline}{rest}"
    if doing:
        detail = f"{doing}: {detail}"
    if isinstance(error, Exception | SystemExit) and _is_due(error, place):
        log.error("%s", detail, exc_info=error)
    return AdsError(ADS_E_EXCEPTION, detail)


def _place(error: BaseException) -> str:
    """The innermost line of the package that was called: neither ours, nor Python's, nor that of a library it uses."""
    author, place = "", ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        package = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        if not author and package != _OURS and package not in sys.stdlib_module_names:
            author = package
        if author and package == author:
            place = f"{Path(frame.f_code.co_filename).name}:{line} in {frame.f_code.co_name}"
    return place


def _is_due(error: BaseException, place: str) -> bool:
    now_s = time.monotonic()
    innermost = [f"{frame.f_code.co_filename}:{line}" for frame, line in traceback.walk_tb(error.__traceback__)][-1:]
    key = type(error), place, "".join(innermost)
    with _lock:
        due = now_s - _logged.get(key, -QUIET_S) >= QUIET_S
        if due:
            _logged[key] = now_s
    return due
