"""A plant in this program: its modules come up in order, are there for others, and go down in reverse.

Rule 1: first every module is created (PREOP), then each is brought to its state, whoever is needed before whoever needs. So
interface pointers may form circles.
Rule 2: a module that fails stays where it got to and is told about, once. Those that need it are not brought further; the
others are.
Rule 3: closing takes the youngest down first, so the loggers last, by force. A module that does not end in time is told about
and left behind: the recordings and the logs of the others are finished all the same.
"""

import contextlib
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from types import TracebackType
from typing import Final, Self

from bridge.config import ModulesAccess
from bridge.core.events import MessageSent
from bridge.core.hresult import AdsError
from bridge.host.news import News
from bridge.host.plan import USER_RANK, Plan, Planned
from bridge.host.surroundings import Surroundings
from bridge.host.system import Logger, SystemModule
from bridge.publisher import Publisher
from bridge.tccom.calls import Access
from bridge.tccom.factories import Factories
from bridge.tccom.identity import ObjectId
from bridge.tccom.module import Module
from bridge.tccom.proxy import RemoteTargets
from bridge.tccom.raised import as_ads_error
from bridge.tccom.reports import Report, ReportKind
from bridge.tccom.server import ObjectServer
from bridge.tccom.service import ObjectService
from bridge.tccom.states import State

DOWN_S: Final = 0.7
"""What taking down the modules of others may take, all together."""
LEAST_S: Final = 0.05
"""What each of them gets even so."""
SYSTEM_S: Final = 1.5
"""What one of ours may take."""
UP_S: Final = 10.0
"""How long the others wait for a module that comes up."""
ACCESS: Final[dict[ModulesAccess, frozenset[Access]]] = {
    "none": frozenset(),
    "read": frozenset({Access.READ}),
    "call": frozenset({Access.READ, Access.SET, Access.CALL}),
    "all": frozenset(Access),
}
"""What the setting modules_access allows."""


class Host:
    """Runs the modules of a plan. A context manager; start() brings them up."""

    def __init__(
        self,
        plan: Plan,
        around: Surroundings,
        factories: Factories | None = None,
        *,
        told: Callable[[MessageSent], None] = lambda _: None,
    ) -> None:
        """told hears of each step and failure. ObjectsTakenError when somebody serves the target's objects already."""
        self.plan, self.around = plan, around
        self.target = around.settings.one_target
        self._down: set[ObjectId] = set()
        self._told: set[ObjectId] = set()
        self._not_ended: dict[ObjectId, str] = {}
        self._closing = False
        with ExitStack() as opened:
            has_logger = any(each.module_class is Logger for each in plan.modules)
            self._publisher = (
                None if has_logger else opened.enter_context(Publisher(around.bus, self.target, realm=around.settings.realm))
            )
            self.news = News(self.target, self._send, told)
            around.on_logger = self.news.flush
            remote = opened.enter_context(RemoteTargets(around.bus, realm=around.settings.realm))
            self.server = opened.enter_context(ObjectServer(factories=factories, report=self._report, remote=remote))
            opened.callback(self._take_down)
            self._service = opened.enter_context(
                ObjectService(
                    self.server,
                    around.bus,
                    self.target,
                    realm=around.settings.realm,
                    allow=ACCESS[around.settings.modules_access],
                )
            )
            self._opened = opened.pop_all()

    def _report(self, report: Report) -> None:
        if report.kind in (ReportKind.FAILED, ReportKind.UNDO_FAILED) and self._closing:
            self._not_ended[report.object_id] = report.object_name
        if report.kind is ReportKind.FAILED:
            self._told.add(report.object_id)
        self.news.report(report)

    def _send(self, event: MessageSent) -> bool:
        if self._publisher is not None:
            self._publisher.send(event)
            return True
        logger = self.around.logger()
        if logger is None:
            return False
        logger.report(event)
        return True

    def start(self) -> None:
        """Bring every module to its state, as far as it gets."""
        for each in self.plan.modules:
            self._create(each)
        for each in self.plan.modules:
            if each.rank == USER_RANK:
                self.news.open()
            self._bring_up(each)
        self.news.open()

    def _create(self, each: Planned) -> None:
        try:
            self.server.add(
                self._made(each.module_class),
                object_id=each.object_id,
                parent_id=each.parent_id,
                name=each.name,
                parameters=each.parameters,
            )
        except AdsError as error:
            self._failed(each, str(error))

    def _made(self, kind: type[Module]) -> Module:
        try:
            return kind(self.around) if issubclass(kind, SystemModule) else kind()
        except (Exception, SystemExit) as error:
            raise as_ads_error(error, f"{kind.__name__} cannot be made") from error

    def _bring_up(self, each: Planned) -> None:
        if each.object_id in self._down:
            return
        names = {one.object_id: one.name for one in self.plan.modules}
        if missing := [names[number] for number in each.needs if number in self._down and number != each.object_id]:
            self._failed(each, f"it needs {', '.join(missing)}")
            return
        failures: list[str] = []

        def step() -> None:
            try:
                self.server.set_state(each.object_id, each.state)
            except AdsError as error:
                failures.append(str(error))

        thread = threading.Thread(target=step, name=f"start {each.name}", daemon=True)
        thread.start()
        thread.join(UP_S)
        if thread.is_alive():
            failures.append(f"it is not up after {UP_S:g} s")
        for why in failures:
            self._failed(each, why)

    def _failed(self, each: Planned, why: str) -> None:
        self._down.add(each.object_id)
        if each.object_id not in self._told:
            self.news.not_started(each.object_id, each.name, why)

    def _take_down(self) -> None:
        """Take the modules down, the youngest first, each on a thread that may be left behind."""
        self._closing = True
        left_s = DOWN_S
        for each in reversed(self.plan.modules):
            begun_s = time.monotonic()
            thread = threading.Thread(target=self._delete, args=(each.object_id,), name=f"end {each.name}", daemon=True)
            thread.start()
            thread.join(SYSTEM_S if each.rank < USER_RANK else max(LEAST_S, left_s))
            if thread.is_alive():
                self._not_ended[each.object_id] = each.name
                self.news.not_ended(each.object_id, each.name)
            left_s -= time.monotonic() - begun_s

    def _delete(self, object_id: ObjectId) -> None:
        with contextlib.suppress(AdsError):  # what fails is reported, and what is not there needs no end
            self.server.delete(object_id, force=True)

    def not_up(self) -> tuple[str, ...]:
        """The names of the modules that are not in the state that the plan wants."""
        states = {info.object_id: info.state for info in self.server.objects()}
        return tuple(each.name for each in self.plan.modules if states.get(each.object_id, State.INIT) < each.state)

    def not_ended(self) -> tuple[str, ...]:
        """The names of the modules that failed while they were taken down, or were left behind."""
        return tuple(self._not_ended.values())

    def close(self) -> None:
        """Take everything down. Any number of times."""
        self._opened.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
