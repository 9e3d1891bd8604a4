"""Laws of objects: whatever is created, held, moved, failed and deleted in whatever order, the books are right.

No object lives without a holder, none goes with one, ids are unique, and a failed step leaves what the last completed one left.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule, run_state_machine_as_test

from bridge.core.hresult import AdsError
from bridge.tccom.general import IObject
from bridge.tccom.identity import CREATE_NEW_ID, FIRST_FREE_ID, LAST_FREE_ID, OBJECT_SERVER_ID
from bridge.tccom.module import Module
from bridge.tccom.references import Reference
from bridge.tccom.server import ObjectServer
from bridge.tccom.states import State, Step, Transition, path

T = Transition
ACQUIRED = {State.INIT: [], State.PREOP: [T.IP], State.SAFEOP: [T.IP, T.PS], State.OP: [T.IP, T.PS, T.SO]}
OWNERS = ["", "one", "two"]
UP = st.sampled_from([State.PREOP, State.SAFEOP, State.OP])
FAILS = st.one_of(st.just(set[Transition]()), st.sets(st.sampled_from(T), max_size=2))
NUMBER = st.integers(0, 99)


class Thing(Module):
    """Acquires something in each step up, and fails in the steps a test names, after it has acquired."""

    def __init__(self, fails: set[Transition], target: int | None) -> None:
        self.fails, self.target = fails, target
        self.acquired: list[Transition] = []

    @contextmanager
    def _acquire(self, transition: Transition) -> Iterator[None]:
        self.acquired.append(transition)
        yield
        assert self.acquired.pop() is transition

    def _hook(self, transition: Transition) -> None:
        if transition in (T.IP, T.PS, T.SO):
            self.enter(self._acquire(transition))
        if transition is T.PS and self.target is not None:
            self.connect(self.target, IObject)
        if transition in self.fails:
            raise OSError(transition)

    def on_ip(self) -> None:
        self._hook(T.IP)

    def on_ps(self) -> None:
        self._hook(T.PS)

    def on_so(self) -> None:
        self._hook(T.SO)

    def on_os(self) -> None:
        self._hook(T.OS)

    def on_sp(self) -> None:
        self._hook(T.SP)

    def on_pi(self) -> None:
        self._hook(T.PI)


class Expected:
    """What the law says of one object."""

    def __init__(self, module: Thing, object_id: int) -> None:
        self.module, self.object_id = module, object_id
        self.state = State.INIT
        self.registered = False
        self.holders = 0
        self.connected: Expected | None = None


class Held:
    """A reference, and how often it holds."""

    def __init__(self, reference: Reference[IObject], thing: Expected, owner: str) -> None:
        self.reference, self.thing, self.owner, self.count = reference, thing, owner, 1


class ObjectLaws(RuleBasedStateMachine):
    """Random objects, references, transitions and failures beside a model of a page."""

    def __init__(self) -> None:
        super().__init__()
        self.server = ObjectServer()
        self.things: list[Expected] = []
        self.held: list[Held] = []

    def teardown(self) -> None:
        for held in self.held:
            held.reference.safe_release()
        assert self.server.close() == 0
        assert self.server.living == 0
        assert all(thing.module.acquired == [] for thing in self.things)

    # The model.

    def there(self, object_id: int | None) -> Expected | None:
        return next((thing for thing in self.things if thing.registered and thing.object_id == object_id), None)

    @property
    def registered(self) -> list[Expected]:
        return [thing for thing in self.things if thing.registered]

    def walk(self, thing: Expected, state: State, *, force: bool = False) -> bool:
        """Whether the whole way succeeds; the object is where it should be then."""
        return all(self.step(thing, step, force=force) for step in path(thing.state, state))

    def step(self, thing: Expected, step: Step, *, force: bool) -> bool:
        fails = step.transition in thing.module.fails
        if step.target > step.source:
            target = self.there(thing.module.target)
            if step.transition is T.PS and thing.module.target is not None:
                if target is None or fails:
                    return False
                thing.connected, target.holders = target, target.holders + 1
            elif fails:
                return False
        else:
            if fails and not force:
                return False
            if step.transition is T.SP and thing.connected is not None:
                thing.connected.holders -= 1
                thing.connected = None
        thing.state = step.target
        if thing.state is State.INIT:
            thing.registered, thing.holders = False, thing.holders - 1
        return True

    # What happens.

    @rule(
        state=UP,
        fails=FAILS,
        other=NUMBER,
        connects=st.booleans(),
        holds=st.booleans(),
        own_id=st.sampled_from([CREATE_NEW_ID, 0x1001, 0x1002]),
    )
    def create(self, state: State, fails: set[Transition], other: int, connects: bool, holds: bool, own_id: int) -> None:
        there = self.registered
        target_id = there[other % len(there)].object_id if there and connects else None
        module = Thing(fails, target_id)
        expected = Expected(module, own_id)
        if self.there(own_id) is not None or T.IP in fails:
            with pytest.raises(AdsError):
                self.server.add(module, object_id=own_id, state=state)
            assert module.acquired == []
            return
        expected.state, expected.registered, expected.holders = State.PREOP, True, 1
        if not self.walk(expected, state):
            self.walk(expected, State.INIT, force=True)
            with pytest.raises(AdsError):
                self.server.add(module, object_id=own_id, state=state)
            assert module.acquired == []
            return
        expected.object_id = self.server.add(module, object_id=own_id, state=state)
        if own_id == CREATE_NEW_ID:
            assert FIRST_FREE_ID <= expected.object_id <= LAST_FREE_ID
        self.things.append(expected)
        if holds:
            self.hold_one(expected, "")

    @precondition(lambda self: self.registered)
    @rule(number=NUMBER, owner=st.sampled_from(OWNERS))
    def hold(self, number: int, owner: str) -> None:
        self.hold_one(self.registered[number % len(self.registered)], owner)

    def hold_one(self, thing: Expected, owner: str) -> None:
        self.held.append(Held(self.server.get(thing.object_id, IObject, owner=owner), thing, owner))
        thing.holders += 1

    @precondition(lambda self: self.held)
    @rule(number=NUMBER)
    def hold_more(self, number: int) -> None:
        held = self.held[number % len(self.held)]
        assert held.reference.add_ref() == held.thing.holders + 1
        held.count += 1
        held.thing.holders += 1

    @precondition(lambda self: self.held)
    @rule(number=NUMBER)
    def release(self, number: int) -> None:
        held = self.held[number % len(self.held)]
        held.thing.holders -= 1
        held.count -= 1
        assert held.reference.release() == held.thing.holders
        if not held.count:
            self.held.remove(held)
            with pytest.raises(AdsError):
                held.reference.release()

    @precondition(lambda self: self.held)
    @rule(number=NUMBER)
    def safe_release(self, number: int) -> None:
        held = self.held.pop(number % len(self.held))
        held.thing.holders -= held.count
        held.reference.safe_release()
        held.reference.safe_release()

    @rule(owner=st.sampled_from(OWNERS[1:]))
    def owner_dies(self, owner: str) -> None:
        gone = [held for held in self.held if held.owner == owner]
        for held in gone:
            held.thing.holders -= held.count
            self.held.remove(held)
        assert self.server.release_owner(owner) == len(gone)

    @precondition(lambda self: self.things)
    @rule(number=NUMBER, fails=FAILS)
    def change_failures(self, number: int, fails: set[Transition]) -> None:
        self.things[number % len(self.things)].module.fails = fails

    @precondition(lambda self: self.registered)
    @rule(number=NUMBER, state=st.sampled_from(State))
    def move(self, number: int, state: State) -> None:
        thing = self.registered[number % len(self.registered)]
        if self.walk(thing, state):
            self.server.set_state(thing.object_id, state)
        else:
            with pytest.raises(AdsError):
                self.server.set_state(thing.object_id, state)

    @precondition(lambda self: self.registered)
    @rule(number=NUMBER, force=st.booleans())
    def delete(self, number: int, force: bool) -> None:
        thing = self.registered[number % len(self.registered)]
        if self.walk(thing, State.INIT, force=force):
            self.server.delete(thing.object_id, force=force)
        else:
            with pytest.raises(AdsError):
                self.server.delete(thing.object_id, force=force)

    @precondition(lambda self: self.held)
    @rule(number=NUMBER, state=UP)
    def move_by_reference(self, number: int, state: State) -> None:
        held = self.held[number % len(self.held)]
        if held.thing.registered and self.walk(held.thing, state):
            held.reference.interface.set_state(state)
        else:
            with pytest.raises(AdsError):
                held.reference.interface.set_state(state)

    # The laws.

    @invariant()
    def ids_are_unique_and_as_expected(self) -> None:
        ids = [info.object_id for info in self.server.objects()]
        assert len(set(ids)) == len(ids)
        assert sorted(ids) == sorted([OBJECT_SERVER_ID, *(thing.object_id for thing in self.things if thing.registered)])

    @invariant()
    def who_is_held_lives_and_nobody_else(self) -> None:
        assert self.server.living == 1 + sum(thing.holders > 0 for thing in self.things)
        for held in self.held:
            assert held.reference.interface.get_object_id().value == held.thing.object_id

    @invariant()
    def every_object_is_where_its_last_completed_step_left_it(self) -> None:
        for thing in self.things:
            assert thing.module.state is thing.state
            assert thing.module.acquired == ACQUIRED[thing.state]
            if thing.registered:
                assert self.server.object_info(thing.object_id).references == thing.holders


def test_objects_live_as_long_as_they_are_held() -> None:
    """The laws hold after every step of any course of events, and closing leaves nothing."""
    run_state_machine_as_test(ObjectLaws, settings=settings(max_examples=150, stateful_step_count=50))
