"""One object as its server keeps it: its turn, its steps, its values, and who holds it.

Rule 1: whoever wants something of an object waits for its turn, at most patience_s (then ADS_E_TIMEOUT): two objects that wait
for each other are told so instead of standing still. A turn may be taken again by the thread that has it.
Rule 2: a step up collects what it acquires in a stack of its own. When it fails the stack is unwound, when it is undone too.
Rule 3: holders are counted. The object server is one of them from registering to signing off. At zero the object is gone.
Rule 4: a watch compares its value whenever a turn ends, and tells a change before the next turn begins.
"""

import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Final, Protocol, TypeVar

import msgspec

from bridge.core.hresult import (
    ADS_E_EXCEPTION,
    ADS_E_INVALIDACCESS,
    ADS_E_INVALIDSTATE,
    ADS_E_NOTINIT,
    ADS_E_TIMEOUT,
    S_OK,
    AdsError,
)
from bridge.tccom.declarations import UNSET, Address, InterfacePointer, Parameter, Settable
from bridge.tccom.general import IDataAreas, IObject, ObjectInfo, ParameterKey, Parameters
from bridge.tccom.identity import NO_OBJECT, InterfaceId, ObjectId, id_text
from bridge.tccom.interfaces import Answer, Interface, InterfaceInfo, Method, carry_out, describe
from bridge.tccom.module import Module, Server
from bridge.tccom.reports import Report, ReportKind
from bridge.tccom.states import State, Step, Transition, path

T = TypeVar("T")
log: Final = logging.getLogger(__name__)

SLOW_NS: Final = 100_000_000
"""A real-time transition (SO, OS) that takes longer is reported."""
_OWN_TURN: Final = (describe(IObject).id, describe(IDataAreas).id)
"""Interfaces whose methods take the turn themselves where they need it: a name can be read while a slow hook runs."""
_STACKS: Final = {State.PREOP: Transition.IP, State.SAFEOP: Transition.PS, State.OP: Transition.SO}

_steps = threading.local()


def current_step() -> tuple[ObjectId, Step] | None:
    """The object and transition whose hook this thread is in, when it is in one."""
    stack = getattr(_steps, "stack", ())
    return stack[-1] if stack else None


@contextmanager
def _in_step(object_id: ObjectId, step: Step) -> Iterator[None]:
    if not hasattr(_steps, "stack"):
        _steps.stack = []
    _steps.stack.append((object_id, step))
    try:
        yield
    finally:
        _steps.stack.pop()


class Keeper(Server, Protocol):
    """What an object needs of the object server that keeps it."""

    patience_s: float

    def connect(self, address: Address, interface: Interface[T], owner: str) -> AbstractContextManager[T]:
        """A reference to an object of this server or of another."""
        ...

    def tell(self, report: Report) -> None:
        """Pass a report on."""
        ...

    def now_ns(self) -> int:
        """A clock for durations."""
        ...

    def signed_off(self, live: "LiveObject") -> None:
        """The object has done PI."""
        ...

    def gone(self, live: "LiveObject") -> None:
        """Nobody holds the object any more."""
        ...


class Watch:
    """Tells changes of a parameter or symbol, first what it is now. A context manager; left, it tells nothing more."""

    def __init__(self, live: "LiveObject", read: Callable[[], object], tell: Callable[[object], None]) -> None:
        self._live, self._read, self._tell = live, read, tell
        self._last: object = UNSET

    def compare(self) -> None:
        """Tell the value when it is another one than last time. Called by the object at the end of a turn."""
        try:
            value = self._read()
            if value != self._last:
                self._last = value
                self._tell(value)
        except Exception:
            # Whoever watches must not disturb whom it watches.
            log.exception("%s: a watch failed", self._live)

    def close(self) -> None:
        """End it. Any number of times."""
        self._live.unwatch(self)

    def __enter__(self) -> "Watch":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class LiveObject:
    """An object in its server: module is the author's, the rest is ours."""

    def __init__(self, module: Module, keeper: Keeper, object_id: ObjectId, name: str, parent_id: ObjectId) -> None:
        self.module, self.object_id, self.name, self.parent_id = module, object_id, name, parent_id
        self.state = State.INIT
        self.references = 1
        self.registered = True
        self._keeper = keeper
        self._turn = threading.RLock()
        self._stacks: dict[Transition, ExitStack] = {}
        self._pointed: dict[str, object] = {}
        self._watches: list[Watch] = []
        self._count = threading.Lock()
        module._place = self

    def __str__(self) -> str:
        return f"{self.name or type(self.module).__name__} ({id_text(self.object_id)})"

    @property
    def server(self) -> Server:
        """The object server."""
        return self._keeper

    def info(self) -> ObjectInfo:
        """What everybody may know; waits for nobody's turn."""
        kind = type(self.module)
        return ObjectInfo(
            object_id=self.object_id,
            name=self.name,
            class_id=kind.class_id,
            class_name=kind.__name__,
            parent_id=self.parent_id,
            state=self.state,
            references=self.references,
            interfaces=tuple(kind.interfaces),
            categories=kind.categories,
        )

    @property
    def interfaces(self) -> Mapping[InterfaceId, InterfaceInfo]:
        """What it offers."""
        return type(self.module).interfaces

    # Holders.

    def add_ref(self) -> int:
        """One holder more; the count. AdsError (ADS_E_INVALIDSTATE) when the object is gone."""
        with self._count:
            if not self.references:
                raise AdsError(ADS_E_INVALIDSTATE, f"{self} is gone")
            self.references += 1
            return self.references

    def release(self) -> int:
        """One holder less; the count. At 0 the object is gone."""
        with self._count:
            self.references -= 1
            left = self.references
        if left == 0:
            self._keeper.gone(self)
        return left

    # Its turn.

    @contextmanager
    def turn(self) -> Iterator[None]:
        """Have the object alone; AdsError (ADS_E_TIMEOUT) when others do not let go in time."""
        if not self._turn.acquire(timeout=self._keeper.patience_s):
            raise AdsError(ADS_E_TIMEOUT, f"{self} was busy for {self._keeper.patience_s} s")
        try:
            yield
        finally:
            try:
                for watch in tuple(self._watches):
                    watch.compare()
            finally:
                self._turn.release()

    def call(self, info: InterfaceInfo, method: Method, arguments: msgspec.Struct) -> Answer[object]:
        """Carry out a call of one of its interfaces."""
        if info.id in _OWN_TURN or (type(self.module).thread_safe and not self._watches):
            return carry_out(self.module, method, arguments)
        if type(self.module).thread_safe:
            answer = carry_out(self.module, method, arguments)
            with self.turn():
                return answer
        with self.turn():
            return carry_out(self.module, method, arguments)

    # Its steps.

    def set_state(self, state: State) -> None:
        """Walk to a state, step by step; AdsError when a step fails. INIT takes the object down and signs it off."""
        self.walk(state)

    def walk(self, state: State, *, force: bool = False) -> None:
        """As set_state(); by force a failing step down is reported, and the way down goes on."""
        with self.turn():
            if not self.registered:
                raise AdsError(ADS_E_INVALIDSTATE, f"{self} has signed off")
            doing = getattr(_steps, "stack", ())
            if any(object_id == self.object_id for object_id, _ in doing):
                raise AdsError(ADS_E_INVALIDSTATE, f"{self} is in a transition")
            for step in path(self.state, state):
                if step.target > step.source:
                    self._up(step)
                else:
                    self._down(step, force)

    def _up(self, step: Step) -> None:
        begun_ns = self._keeper.now_ns()
        self._stacks[step.transition] = ExitStack()
        try:
            with _in_step(self.object_id, step):
                self._prepare(step)
                self._hook(step)()
        except Exception as error:
            self._unwind(step.transition, step)
            raise self._failed(step, error, begun_ns) from error
        except BaseException as error:
            self._unwind(step.transition, step)
            self._failed(step, error, begun_ns)
            raise
        self._completed(step, begun_ns)

    def _down(self, step: Step, force: bool) -> None:
        begun_ns = self._keeper.now_ns()
        try:
            with _in_step(self.object_id, step):
                self._hook(step)()
        except Exception as error:
            failure = self._failed(step, error, begun_ns)
            if not force:
                raise failure from error
        assert step.undoes is not None
        self._unwind(step.undoes, step)
        self._completed(step, begun_ns)
        if step.target is State.INIT:
            self.registered = False
            self._keeper.signed_off(self)

    def _hook(self, step: Step) -> Callable[[], None]:
        hook: Callable[[], None] = getattr(self.module, f"on_{step.transition.lower()}")
        return hook

    def _prepare(self, step: Step) -> None:
        """What a step up does before its hook: look for missing parameters, resolve pointers."""
        declared = type(self.module).declared
        if step.transition is Transition.PS:
            for name, parameter in declared.parameters.items():
                if self.module._values.get(name, parameter.default) is UNSET:
                    raise AdsError(ADS_E_NOTINIT, f"parameter {name!r} was not given")
        for pointer in declared.pointers.values():
            if pointer.resolved.transition is step.transition and pointer.required:
                self._resolve(pointer)

    def _unwind(self, acquired: Transition, step: Step) -> None:
        for name, pointer in type(self.module).declared.pointers.items():
            if pointer.resolved.transition is acquired:
                self._pointed.pop(name, None)
        stack = self._stacks.pop(acquired, None)
        try:
            if stack is not None:
                with _in_step(self.object_id, step):
                    stack.close()
        except Exception as error:  # noqa: BLE001 # whatever it is, the rest has been undone; it is told, and the way goes on
            self.report(ReportKind.UNDO_FAILED, transition=step.transition, code=_code(error), detail=_detail(error))

    def _failed(self, step: Step, error: BaseException, begun_ns: int) -> AdsError:
        took_ns = self._keeper.now_ns() - begun_ns
        self.report(
            ReportKind.FAILED, transition=step.transition, code=_code(error), detail=_detail(error), duration_ns=took_ns
        )
        return AdsError(_code(error), f"{self}: {step.transition}: {_detail(error)}")

    def _completed(self, step: Step, begun_ns: int) -> None:
        took_ns = self._keeper.now_ns() - begun_ns
        self.state = step.target
        self.report(ReportKind.DONE, transition=step.transition, duration_ns=took_ns)
        if step.real_time and took_ns > SLOW_NS:
            self.report(
                ReportKind.SLOW, transition=step.transition, duration_ns=took_ns, detail=f"over {SLOW_NS // 1_000_000} ms"
            )

    def report(
        self,
        kind: ReportKind,
        *,
        transition: Transition | None = None,
        code: int = S_OK,
        detail: str = "",
        duration_ns: int = 0,
    ) -> None:
        """Tell what happened to it."""
        self._keeper.tell(
            Report(
                kind=kind,
                object_id=self.object_id,
                object_name=self.name,
                class_name=type(self.module).__name__,
                state=self.state,
                transition=transition,
                duration_ns=duration_ns,
                code=code,
                detail=detail,
            )
        )

    # What it has acquired.

    def enter(self, manager: AbstractContextManager[T], transition: Transition | None = None) -> T:
        """Enter a context manager that is left when a transition is undone: the current one, or else the last one up."""
        step = current_step()
        if transition is None and step is not None and step[0] == self.object_id:
            transition = step[1].undoes or step[1].transition
        stack = self._stacks.get(transition or _STACKS.get(self.state, Transition.IP))
        if stack is None:
            raise AdsError(ADS_E_INVALIDSTATE, f"{self} is in no state to acquire anything")
        return stack.enter_context(manager)

    def connect(self, address: Address, interface: Interface[T]) -> T:
        """A reference that is released when the transition is undone."""
        return self.enter(self._keeper.connect(address, interface, id_text(self.object_id)))

    def _resolve(self, pointer: InterfacePointer[T]) -> T:
        address = pointer.address(self.module)
        if address == NO_OBJECT:
            raise AdsError(ADS_E_NOTINIT, f"interface pointer {pointer.name!r} names no object")
        reference = self._keeper.connect(address, pointer.interface, id_text(self.object_id))
        found = self.enter(reference, pointer.resolved.transition)
        self._pointed[pointer.name] = found
        return found

    def pointed(self, pointer: InterfacePointer[T]) -> T:
        """The stub of a pointer; one that is not required is looked for here."""
        found = self._pointed.get(pointer.name)
        if found is not None:
            return found  # type: ignore[return-value] # _resolve() has put it there for this very pointer
        if pointer.required or pointer.resolved.transition not in self._stacks:
            raise AdsError(ADS_E_NOTINIT, f"{self}: interface pointer {pointer.name!r} is set in {pointer.resolved}")
        return self._resolve(pointer)

    # Its values.

    def initialize(self, parameters: Parameters) -> None:
        """Take what it is created with; AdsError: ADS_E_NOTFOUND, ADS_E_INVALIDACCESS, ADS_E_INVALIDDATA."""
        for key, value in parameters.items():
            one = type(self.module).declared.value(key)
            if isinstance(one, Parameter) and not one.settable:
                raise AdsError(ADS_E_INVALIDACCESS, f"parameter {one.name!r} is not set from outside")
            self.module._values[one.name] = one.checked(value)

    def get_parameter(self, key: ParameterKey) -> object:
        """A parameter as plain data; of a pointer the object it names."""
        one = type(self.module).declared.value(key)
        if isinstance(one, InterfacePointer):
            return one.address(self.module)
        return msgspec.to_builtins(one.__get__(self.module, type(self.module)), builtin_types=(bytes,), str_keys=True)

    def set_parameter(self, key: ParameterKey, value: object) -> None:
        """Set it from outside; AdsError: ADS_E_NOTFOUND, ADS_E_INVALIDACCESS, ADS_E_INVALIDSTATE, ADS_E_INVALIDDATA."""
        one = type(self.module).declared.value(key)
        settable = one.settable if isinstance(one, Parameter) else Settable.INIT
        if not settable:
            raise AdsError(ADS_E_INVALIDACCESS, f"parameter {one.name!r} is not set from outside")
        checked = one.checked(value)
        with self.turn():
            now = Settable.INIT if self.state <= State.PREOP else Settable.OP if self.state is State.OP else Settable.NEVER
            if not settable & now:
                raise AdsError(ADS_E_INVALIDSTATE, f"parameter {one.name!r} is not set in {self.state.name}")
            values = self.module._values
            before = values.get(one.name, UNSET)
            values[one.name] = checked
            try:
                self.module.on_parameter(one.name)
            except BaseException as error:
                if before is UNSET:
                    del values[one.name]
                else:
                    values[one.name] = before
                if isinstance(error, AdsError) or not isinstance(error, Exception):
                    raise
                raise AdsError(ADS_E_EXCEPTION, f"{one.name}: {_detail(error)}") from error

    def read_symbol(self, path: str) -> object:
        """A symbol or area as plain data; "" is all areas."""
        declared = type(self.module).declared
        with self.turn():
            if not path:
                return {name: area.read(self.module, ()) for name, area in declared.areas.items()}
            area, below = declared.symbol(path)
            return area.read(self.module, below)

    def write_symbol(self, path: str, value: object) -> None:
        """Set a symbol of a writable area."""
        area, below = type(self.module).declared.symbol(path)
        with self.turn():
            area.write(self.module, below, value)

    def watch(self, key: ParameterKey, tell: Callable[[object], None]) -> Watch:
        """Tell a parameter's or symbol's value now and at each change; AdsError (ADS_E_NOTFOUND, ADS_E_SYMBOLNOTFOUND).

        A key with a dot, or the name of an area, is a symbol. tell is called while the object has its turn: it returns soon
        and asks nothing of the object.
        """
        declared = type(self.module).declared
        if isinstance(key, str) and key.split(".")[0] in declared.areas:
            area, below = declared.symbol(key)
            watch = Watch(self, lambda: area.read(self.module, below), tell)
            area.read(self.module, below)
        else:
            declared.value(key)
            watch = Watch(self, lambda: self.get_parameter(key), tell)
        with self.turn():
            self._watches.append(watch)
        return watch

    def unwatch(self, watch: Watch) -> None:
        """End a watch."""
        with self.turn():
            if watch in self._watches:
                self._watches.remove(watch)


def _code(error: BaseException) -> int:
    return error.code if isinstance(error, AdsError) else ADS_E_EXCEPTION


def _detail(error: BaseException) -> str:
    return error.detail or error.text if isinstance(error, AdsError) else f"{type(error).__name__}: {error}"
