"""Which classes of modules there are: a table, filled by the program and by installed packages.

Rule 1: a package offers its classes as entry points of the group "tcbridge.modules": each names a module class, or a Python
module whose module classes are all meant. They are looked up when an id or name is asked for that is not in the table yet.
Rule 2: a class is found by its class id or its name. A name that two classes have is refused; their ids are not.
Rule 3: a package that cannot be loaded takes no other with it. It is logged, and kept in `faults`.
"""

import inspect
import logging
import threading
from collections.abc import Iterator
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import Final

from bridge.core.arguments import guid
from bridge.core.hresult import ADS_E_EXISTS, ADS_E_INVALIDCLSID, AdsError
from bridge.tccom.identity import ClassId
from bridge.tccom.module import Module

log: Final = logging.getLogger(__name__)

GROUP: Final = "tcbridge.modules"


class Factories:
    """The table. For any number of threads."""

    def __init__(self, *, installed: bool = True) -> None:
        """installed: whether the classes of installed packages are found too."""
        self.faults: dict[str, str] = {}
        self._classes: dict[ClassId, type[Module]] = {}
        self._pending = installed
        self._lock = threading.Lock()

    def register(self, *classes: type[Module]) -> None:
        """Add classes; AdsError: ADS_E_INVALIDCLSID when one has no class id, ADS_E_EXISTS when another has it."""
        with self._lock:
            for one in classes:
                self._register(one)

    def classes(self) -> tuple[type[Module], ...]:
        """All of them, by name."""
        with self._lock:
            self._load()
            return tuple(sorted(self._classes.values(), key=lambda one: (one.__name__, one.class_id)))

    def find(self, key: ClassId) -> type[Module]:
        """The class of an id or name; AdsError (ADS_E_INVALIDCLSID)."""
        with self._lock:
            for _ in range(2):
                named = [one for one in self._classes.values() if one.__name__ == key]
                if len(named) == 1:
                    return named[0]
                if (one := self._classes.get(_as_guid(key))) is not None:
                    return one
                if not self._pending:
                    break
                self._load()
        if named:
            ids = ", ".join(one.class_id for one in named)
            raise AdsError(ADS_E_INVALIDCLSID, f"{key!r} is the name of {len(named)} classes ({ids}); give the id")
        raise AdsError(ADS_E_INVALIDCLSID, f"no module class {key!r}")

    def _register(self, one: type[Module]) -> None:
        if not one.class_id:
            raise AdsError(ADS_E_INVALIDCLSID, f"{one.__name__} has no class_id")
        known = self._classes.setdefault(one.class_id, one)
        if known is not one:
            raise AdsError(ADS_E_EXISTS, f"{one.__name__} has the class id of {known.__name__}: {one.class_id}")

    def _load(self) -> None:
        if not self._pending:
            return
        self._pending = False
        for point in entry_points(group=GROUP):
            try:
                for one in _offered(point):
                    self._register(one)
            except (Exception, SystemExit) as error:
                log.exception("%s: %s = %s cannot be used", GROUP, point.name, point.value)
                self.faults[point.name] = f"{point.value}: {type(error).__name__}: {error}"


def _offered(point: EntryPoint) -> Iterator[type[Module]]:
    found = point.load()
    if isinstance(found, ModuleType):
        for one in vars(found).values():
            if _is_class(one) and one.__module__ == found.__name__:
                yield one
    elif _is_class(found):
        yield found
    else:
        raise TypeError(f"{found!r} is no module class")


def _is_class(value: object) -> bool:
    return inspect.isclass(value) and issubclass(value, Module) and bool(value.class_id)


def _as_guid(key: str) -> str:
    try:
        return guid(key)
    except ValueError:
        return key
