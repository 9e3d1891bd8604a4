"""What others may read, set and watch of a module: its parameters, pointers, data areas.

Rule 1: values go in and out as plain data and are checked against what the module declares.
Rule 2: INIT parameters and pointers are set at creation and in PREOP, OP parameters in OP. In SAFEOP none is.
Rule 3: a module that refuses a parameter, or breaks over it, keeps the old value.
Rule 4: a watch tells what a value is, and then each change that it finds when it compares. It disturbs nobody: what goes wrong
in it is logged.

The caller sees to it that the module has its turn.
"""

import logging
import threading
from collections.abc import Callable
from typing import Final

import msgspec

from bridge.core.hresult import ADS_E_INVALIDACCESS, ADS_E_INVALIDSTATE, AdsError
from bridge.tccom.declarations import UNSET, InterfacePointer, Parameter, Settable
from bridge.tccom.general import ParameterKey, Parameters
from bridge.tccom.module import Module
from bridge.tccom.raised import as_ads_error
from bridge.tccom.states import State

log: Final = logging.getLogger(__name__)

SETTABLE: Final = {State.INIT: Settable.INIT, State.PREOP: Settable.INIT, State.SAFEOP: Settable.NEVER, State.OP: Settable.OP}
"""What may be set in which state (manual 8.1.1.1, "Parameter": during initialization, or at runtime in OP)."""


def initialize(module: Module, parameters: Parameters) -> None:
    """Take what an object is created with; AdsError: ADS_E_NOTFOUND, ADS_E_INVALIDACCESS, ADS_E_INVALIDDATA."""
    for key, value in parameters.items():
        one = module.declared.value(key)
        if isinstance(one, Parameter) and not one.settable:
            raise AdsError(ADS_E_INVALIDACCESS, f"parameter {one.name!r} is not set from outside")
        module._values[one.name] = one.checked(value)


def get_parameter(module: Module, key: ParameterKey) -> object:
    """A parameter as plain data; of a pointer the object it names. AdsError: ADS_E_NOTFOUND, ADS_E_NOTINIT."""
    one = module.declared.value(key)
    if isinstance(one, InterfacePointer):
        return one.address(module)
    return msgspec.to_builtins(one.__get__(module, type(module)), builtin_types=(bytes,), str_keys=True)


def set_parameter(module: Module, key: ParameterKey, value: object, state: State) -> None:
    """Set it from outside; AdsError: ADS_E_NOTFOUND, ADS_E_INVALIDACCESS, ADS_E_INVALIDSTATE, ADS_E_INVALIDDATA."""
    one = module.declared.value(key)
    settable = one.settable if isinstance(one, Parameter) else Settable.INIT
    if not settable:
        raise AdsError(ADS_E_INVALIDACCESS, f"parameter {one.name!r} is not set from outside")
    if not settable & SETTABLE[state]:
        raise AdsError(ADS_E_INVALIDSTATE, f"parameter {one.name!r} is not set in {state.name}")
    values = module._values
    before = values.get(one.name, UNSET)
    values[one.name] = one.checked(value)
    try:
        module.on_parameter(one.name)
    except BaseException as error:
        if before is UNSET:
            del values[one.name]
        else:
            values[one.name] = before
        if isinstance(error, AdsError) or not isinstance(error, Exception | SystemExit):
            raise
        raise as_ads_error(error, one.name) from error


def read_symbol(module: Module, path: str) -> object:
    """A symbol or area as plain data; "" is all areas; AdsError (ADS_E_SYMBOLNOTFOUND)."""
    if not path:
        return {name: area.read(module, ()) for name, area in module.declared.areas.items()}
    area, below = module.declared.symbol(path)
    return area.read(module, below)


def write_symbol(module: Module, path: str, value: object) -> None:
    """Set a symbol of a writable area; AdsError: ADS_E_SYMBOLNOTFOUND, ADS_E_INVALIDACCESS, ADS_E_INVALIDDATA."""
    area, below = module.declared.symbol(path)
    area.write(module, below, value)


def reading(module: Module, key: ParameterKey) -> Callable[[], object]:
    """What reads a parameter, or a symbol when key begins with the name of an area; AdsError when there is none."""
    if isinstance(key, str) and key.split(".")[0] in module.declared.areas:
        read_symbol(module, key)
        return lambda: read_symbol(module, key)
    module.declared.value(key)
    return lambda: get_parameter(module, key)


def same(before: object, now: object) -> bool:
    """Whether a value is still what it was; what is not a number is still not a number. UNSET is no value."""
    if before is UNSET or before == now:
        return before is not UNSET
    return msgspec.msgpack.encode(before) == msgspec.msgpack.encode(now)


class Watch:
    """Tells changes of a value. A context manager; left, it tells nothing more."""

    def __init__(self, read: Callable[[], object], tell: Callable[[object], None], end: Callable[["Watch"], None]) -> None:
        self._read, self._tell, self._end = read, tell, end
        self._last: object = UNSET
        self._closed = False
        self._lock = threading.RLock()

    def compare(self) -> None:
        """Tell the value when it is another one than last time."""
        with self._lock:
            if self._closed:
                return
            try:
                value = self._read()
                if not same(self._last, value):
                    self._last = value
                    self._tell(value)
            except (Exception, SystemExit):
                # Whoever watches must not disturb whom it watches.
                log.exception("a watch failed")

    def close(self) -> None:
        """End it. Any number of times; waits for no more than a telling that is under way."""
        with self._lock:
            self._closed = True
        self._end(self)

    def __enter__(self) -> "Watch":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
