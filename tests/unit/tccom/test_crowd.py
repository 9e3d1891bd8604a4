"""Many threads come, call, move and go at once: nobody gets stuck, and the books are right afterwards."""

import random
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest

from bridge.core.hresult import AdsError
from bridge.tccom.general import IObject
from bridge.tccom.module import Module
from bridge.tccom.references import Reference
from bridge.tccom.reports import Report, ReportKind
from bridge.tccom.server import ObjectServer
from bridge.tccom.states import State
from bridge.tccom.tasks import Task
from tests.unit.tccom.tccom_stories import Calculation, Caller, Counter, ICalculation

PATIENCE_S = 60.0
THREADS = 6
STEPS = 500
CLASSES: list[type[Module]] = [Calculation, Calculation, Caller, Counter]


class Crowd:
    """What each of the threads does, from a seed of its own."""

    def __init__(self, server: ObjectServer) -> None:
        self.server = server
        self.ids: list[int] = []
        self.surprises: list[BaseException] = []
        self.calls = 0
        self.together = threading.Barrier(THREADS, timeout=PATIENCE_S)

    def any_id(self, chance: random.Random) -> int:
        return chance.choice(self.ids[-8:])

    def come(self, chance: random.Random) -> None:
        kind = chance.choice(CLASSES)
        pointers = {"calculation": self.any_id(chance)} if kind is Caller else {}
        task = {"cyclic_caller": self.ids[0]} if kind is Counter else {}
        state = chance.choice([State.PREOP, State.OP])
        transient = chance.random() < 0.2
        with self.server.create(kind, IObject, parameters={**pointers, **task}, state=state, transient=transient) as created:
            self.ids.append(created.get_object_id().value)

    def go(self, chance: random.Random) -> None:
        self.server.delete(chance.choice([1, *self.ids[1:][-12:]]), force=chance.random() < 0.5)

    def move(self, chance: random.Random) -> None:
        self.server.set_state(self.any_id(chance), chance.choice([State.PREOP, State.SAFEOP, State.OP]))

    def call(self, chance: random.Random) -> None:
        with self.server.get(self.any_id(chance), ICalculation) as calculation:
            for number in range(5):
                assert calculation.addition(number, 1).value == number + 1
            self.calls += 1

    def hold(self, chance: random.Random) -> None:
        reference: Reference[IObject] = self.server.get(self.any_id(chance), IObject, owner=chance.choice(["one", "two"]))
        reference.add_ref()
        if chance.random() < 0.5:
            with reference.query(ICalculation) as calculation:
                calculation.subtraction(3, 2)
            reference.release()

    def owner_dies(self, chance: random.Random) -> None:
        self.server.release_owner(chance.choice(["one", "two"]))

    def look(self, chance: random.Random) -> None:
        infos = self.server.objects()
        assert len({info.object_id for info in infos}) == len(infos)
        assert all(info.references >= 0 for info in infos)

    def run(self, seed: int) -> None:
        chance = random.Random(seed)
        does = [self.come, self.come, self.go, self.move, self.call, self.call, self.hold, self.owner_dies, self.look]
        try:
            self.together.wait()
            for _ in range(STEPS):
                with suppress(AdsError):
                    chance.choice(does)(chance)
        except BaseException as surprise:  # noqa: BLE001 # it is shown by the test, not by the thread
            self.surprises.append(surprise)


@pytest.fixture
def many_switches() -> Iterator[None]:
    """Threads take turns after 10 us instead of 5 ms: they meet in the middle of everything."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


@pytest.mark.usefixtures("many_switches")
def test_a_crowd_leaves_the_books_right() -> None:
    """Only AdsErrors are met on the way; when all have let go, who is left is who is registered; closing leaves nobody."""
    before = set(threading.enumerate())
    reports: list[Report] = []
    with ObjectServer(patience_s=PATIENCE_S, report=reports.append) as server:
        crowd = Crowd(server)
        crowd.ids.append(server.add(Task(), parameters={"cycle_ns": 1_000_000}, state=State.OP))
        threads = [threading.Thread(target=crowd.run, args=(seed,)) for seed in range(THREADS)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(PATIENCE_S)
            assert not thread.is_alive()
        assert crowd.surprises == []
        assert crowd.calls > THREADS
        for owner in ("one", "two"):
            server.release_owner(owner)
        for info in server.objects():
            with suppress(AdsError):
                server.set_state(info.object_id, State.PREOP)
        assert server.living == len(server.objects())
    assert server.living == 0
    assert set(threading.enumerate()) <= before
    assert not [report for report in reports if report.kind in (ReportKind.CYCLE_FAILED, ReportKind.UNDO_FAILED)]
