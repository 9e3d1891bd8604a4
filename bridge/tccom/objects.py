"""One object as its server keeps it: its turn, its steps, its values, and who holds it.

Rule 1: whoever wants something of an object waits for its turn, at most patience_s (then ADS_E_TIMEOUT): two objects that wait
for each other are told so instead of standing still. A turn may be taken again by the thread that has it.
Rule 2: a step up collects what it acquires in a stack of its own. When it fails the stack is unwound, when it is undone too.
Rule 3: holders are counted. The object server is one of them from registering to signing off. At zero the object is gone.
Rule 4: a watch compares its value whenever a turn ends, and tells a change before the next turn begins.
"""

import contextlib
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import Final, Protocol, TypeVar

import msgspec

from bridge.core.hresult import (
    ADS_E_INVALIDSTATE,
    ADS_E_NOTFOUND,
    ADS_E_NOTINIT,
    ADS_E_TIMEOUT,
    S_OK,
    AdsError,
)
from bridge.tccom import values
from bridge.tccom.declarations import UNSET, Address, InterfacePointer
from bridge.tccom.general import IDataAreas, IObject, IWatchSource, ObjectInfo, ParameterKey
from bridge.tccom.identity import NO_OBJECT, InterfaceId, ObjectId, id_text
from bridge.tccom.interfaces import Answer, Interface, InterfaceInfo, Method, carry_out, describe
from bridge.tccom.module import Module, Server
from bridge.tccom.raised import as_ads_error
from bridge.tccom.reports import Report, ReportKind
from bridge.tccom.states import State, Step, Transition, path

T = TypeVar("T")

SLOW_NS: Final = 100_000_000
"""A real-time transition (SO, OS) that takes longer is reported."""
_OWN_TURN: Final = (describe(IObject).id, describe(IDataAreas).id, describe(IWatchSource).id)
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

    def patience_s(self) -> float:
        """How long to wait for somebody's turn."""
        ...

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
        self._watches: list[values.Watch] = []
        self._count = threading.Lock()
        module._place = self

    def __str__(self) -> str:
        return f"{self.name or type(self.module).__name__} ({id_text(self.object_id)})"

    @property
    def server(self) -> Server:
        """The object server."""
        return self._keeper

    def patience_s(self) -> float:
        """How long to wait for somebody else."""
        return self._keeper.patience_s()

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
        """One holder more; the count. AdsError (ADS_E_NOTFOUND) when the object is gone."""
        with self._count:
            if not self.references:
                raise AdsError(ADS_E_NOTFOUND, f"{self} is gone")
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
        patience_s = self.patience_s()
        if not self._turn.acquire(timeout=patience_s):
            raise AdsError(ADS_E_TIMEOUT, f"{self} was busy for {patience_s:.1f} s")
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
        """As set_state(); by force a failing step down is reported, and the way down goes on. Who is down already is down."""
        with self.turn():
            if not self.registered and force:
                return
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
        except (Exception, SystemExit) as error:
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
        except (Exception, SystemExit) as error:
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
        declared = self.module.declared
        if step.transition is Transition.PS:
            for name, parameter in declared.parameters.items():
                if self.module._values.get(name, parameter.default) is UNSET:
                    raise AdsError(ADS_E_NOTINIT, f"parameter {name!r} was not given")
        for pointer in declared.pointers.values():
            if pointer.resolved.transition is step.transition and pointer.required:
                self._resolve(pointer)

    def _unwind(self, acquired: Transition, step: Step) -> None:
        try:
            with _in_step(self.object_id, step):
                self._stacks[acquired].close()
        except (Exception, SystemExit) as error:  # noqa: BLE001 # the rest has been undone; it is told, and the way goes on
            failure = as_ads_error(error)
            self.report(ReportKind.UNDO_FAILED, transition=step.transition, code=failure.code, detail=_detail(failure))
        del self._stacks[acquired]
        for name, pointer in self.module.declared.pointers.items():
            if pointer.resolved.transition is acquired:
                self._pointed.pop(name, None)

    def _failed(self, step: Step, error: BaseException, begun_ns: int) -> AdsError:
        took_ns = self._keeper.now_ns() - begun_ns
        failure = as_ads_error(error)
        detail = _detail(failure)
        self.report(ReportKind.FAILED, transition=step.transition, code=failure.code, detail=detail, duration_ns=took_ns)
        return AdsError(failure.code, f"{self}: {step.transition}: {detail}")

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

    def enter(self, manager: AbstractContextManager[T]) -> T:
        """Enter a context manager that is left when a transition is undone: the current one, or else the last one up."""
        return self._stack().enter_context(manager)

    def connect(self, address: Address, interface: Interface[T]) -> T:
        """A reference that is released when the transition is undone."""
        return self._hold(self._stack(), address, interface)

    def _stack(self) -> ExitStack:
        step = current_step()
        transition = _STACKS.get(self.state)
        if step is not None and step[0] == self.object_id:
            transition = step[1].undoes or step[1].transition
        stack = None if transition is None else self._stacks.get(transition)
        if stack is None:
            raise AdsError(ADS_E_INVALIDSTATE, f"{self} is in no state to acquire anything")
        return stack

    def _hold(self, stack: ExitStack, address: Address, interface: Interface[T]) -> T:
        return stack.enter_context(self._keeper.connect(address, interface, id_text(self.object_id)))

    def _resolve(self, pointer: InterfacePointer[T]) -> T:
        address = pointer.address(self.module)
        if address == NO_OBJECT:
            raise AdsError(ADS_E_NOTINIT, f"interface pointer {pointer.name!r} names no object")
        found = self._hold(self._stacks[pointer.resolved.transition], address, pointer.interface)
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

    def get_parameter(self, key: ParameterKey) -> object:
        """A parameter as plain data. Waits for nobody's turn: what it is now may be asked while a hook is slow."""
        return values.get_parameter(self.module, key)

    def set_parameter(self, key: ParameterKey, value: object) -> None:
        """Set it from outside, as values.py says."""
        with self.turn():
            values.set_parameter(self.module, key, value, self.state)

    def read_symbol(self, path: str) -> object:
        """A symbol as plain data, or an area, or all of them."""
        with self.turn():
            return values.read_symbol(self.module, path)

    def write_symbol(self, path: str, value: object) -> None:
        """Set a symbol of a writable area."""
        with self.turn():
            values.write_symbol(self.module, path, value)

    def read_values(self, keys: tuple[ParameterKey, ...]) -> tuple[object, ...]:
        """Parameters and symbols in one turn."""
        readings = [values.reading(self.module, key) for key in keys]
        with self.turn():
            return tuple(read() for read in readings)

    def watch(self, key: ParameterKey, tell: Callable[[object], None]) -> values.Watch:
        """Tell a parameter's or symbol's value now and at each change; AdsError when there is none.

        tell is called while the object has its turn: it returns soon, and asks nothing of the object.
        """
        watch = values.Watch(values.reading(self.module, key), tell, self._unwatch)
        with self.turn():
            self._watches.append(watch)
        return watch

    def _unwatch(self, watch: values.Watch) -> None:
        with contextlib.suppress(ValueError):
            self._watches.remove(watch)


def _detail(error: AdsError) -> str:
    return error.detail or error.text
