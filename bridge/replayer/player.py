"""Recordings onto the bus, at a chosen speed, and told what to do while they play.

Rule 1: the order is (log_time, place in the file); the pace is that of the log times, times the rate.
Rule 2: every event gets a new session, seq and key_seq; the old ones are in its `origin`. It goes to a realm of its own unless
told otherwise, so that nobody takes yesterday for today.
Rule 3: wherever a player starts, goes or starts over, the state there is rebuilt first and served (stage.py).
Rule 4: one thread of ours plays; commands come from any thread and take effect before the next event.
Rule 5: the clock is handed in, and all that waits or stamps runs on replay time (pace.py).
"""

import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Final, Literal, Self, TypeAlias

import msgspec

from bridge.control import PLAYER, Control
from bridge.core import codec
from bridge.core.catalog import Catalog
from bridge.core.control import ControlQuestion, Facts, Pause, Rate, Resume, Seek, Step, Stop
from bridge.core.events import AnyEvent, MessageSent
from bridge.core.filters.ast import Expr
from bridge.core.hresult import ADS_E_INVALIDSTATE, ADS_E_SRVNOTSUPP, AdsError
from bridge.core.times import time_text
from bridge.edges.bus import Bus
from bridge.edges.recording import Part, RecordedEvent, RecordedState, Standing, standing_at
from bridge.replayer.fold import PROGRESS_EVENTS, ReplayReport, entries, filter_alarms, matcher
from bridge.replayer.origins import origin_of, replayed_frame
from bridge.replayer.pace import Pace
from bridge.replayer.span import check_remap, span_of
from bridge.replayer.stage import Stage

PlayerState: TypeAlias = Literal["waiting", "seeking", "playing", "paused", "ended", "failed"]
TAKES: Final = (Pause, Resume, Step, Seek, Rate, Stop)
_LOOK_S: Final = 0.5
"""How long a wait lasts at most before the clock is looked at again."""


class _ElsewhereError(Exception):
    """Finding the state was given up: the player was told to stop, or to go elsewhere."""


def new_realm() -> str:
    """A realm for one replay: replay-<8 hex>."""
    return f"replay-{os.urandom(4).hex()}"


class Player:
    """Plays until the end, or until closed. A context manager; leaving it takes the replay off the bus."""

    def __init__(
        self,
        bus: Bus,
        paths: Sequence[str | os.PathLike[str]],
        filter: Expr | None = None,
        *,
        realm: str | None = None,
        name: str | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
        rate: float = 1.0,
        loop: bool = False,
        paused: bool = False,
        remap: Mapping[str, str] | None = None,
        catalog: Catalog | None = None,
        encoding: codec.Encoding = codec.JSON,
        wait_for_listener_s: float = 0.0,
        on_progress: Callable[[ReplayReport], None] | None = None,
        clock_s: Callable[[], float] = time.monotonic,
        wait: Callable[[threading.Condition, float], object] = threading.Condition.wait,
    ) -> None:
        """Read the summaries, take the name and start. realm None is a new one, name None that of the realm.

        rate 0 is as fast as it can, waiting rather than dropping. remap renames targets. catalog are the event classes that are
        offered with the replay. clock_s and wait are what time passes by: seconds, and waiting so many of them.
        RecordingError for a file that is no recording, ValueError for a wrong rate, RemapError for wrong names of targets,
        NameTakenError when a player has the name, LoggerThereError when a target has a logger in the realm.
        """
        self.span = span_of(paths)
        self.realm = realm or new_realm()
        self.report = ReplayReport(realm=self.realm)
        self.error: Exception | None = None
        self._paths, self._matches, self._remap = paths, matcher(filter), dict(remap or {})
        self._start_ns = self.span.first_ns if start_ns is None else start_ns
        self._end_ns, self._loop, self._rounds = end_ns, loop, 0
        self._patience_s, self._wait, self._on_progress = wait_for_listener_s, wait, on_progress
        self._pace = Pace(rate, clock_s, running=not paused)
        check_remap(self._remap, self.span.targets)
        self._targets = {target: self._remap.get(target, target) for target in self.span.targets}
        self._stage = Stage(
            bus,
            self.realm,
            encoding=encoding,
            catalog=Catalog() if catalog is None else catalog,
            clock=lambda: max(1, self._pace.now_ns),
        )
        self._stage.refuse_loggers(self._targets.values())
        self._news = threading.Condition()
        self._state: PlayerState = "waiting"
        self._steps = 0
        self._goal_ns: int | None = None
        self._stopped = False
        self._next_ns = self._start_ns
        self._pace.jump(self._start_ns)
        name = name or (self.realm if self.realm.startswith("replay-") else f"replay-{self.realm}")
        self.control = Control(bus, name, PLAYER, self._carry_out, self.status, takes=TAKES, realm=self.realm)
        self._thread = threading.Thread(target=self._run, name=f"play {self.realm}", daemon=True)
        self._thread.start()

    # Told by the program, the keyboard or the bus.

    def pause(self) -> None:
        """Stand still before the next event."""
        self._tell(running=False)

    def resume(self) -> None:
        """Go on."""
        self._tell(running=True)

    def step(self, events: int = 1) -> None:
        """Play so many events, then stand still."""
        self._tell(running=False, steps=events)

    def seek(self, at_ns: int) -> None:
        """Go on from a moment of the recording (Unix ns), with the state there rebuilt; a paused player stays paused."""
        self._tell(goal_ns=at_ns)

    def change_rate(self, rate: float) -> None:
        """Play at another rate from now on. ValueError for one below 0."""
        with self._news:
            self._pace.change(rate)
            self._news.notify_all()

    def stop(self) -> None:
        """End before the next event."""
        with self._news:
            self._stopped = True
            self._news.notify_all()

    def _tell(self, *, running: bool | None = None, steps: int = 0, goal_ns: int | None = None) -> None:
        with self._news:
            if self._state in ("ended", "failed"):
                raise AdsError(ADS_E_INVALIDSTATE, "the replay is over")
            if running is not None:
                self._pace.jump(self._at_ns())
                self._pace.run(running)
                self._steps = self._steps + steps if steps else 0
                self._state = "playing" if running or self._steps else "paused"
            if goal_ns is not None:
                self._goal_ns, self._state = goal_ns, "seeking"
            self._news.notify_all()

    def _carry_out(self, question: ControlQuestion) -> None:
        match question.command:
            case Pause():
                self.pause()
            case Resume():
                self.resume()
            case Step(events):
                self.step(events)
            case Seek(to):
                self.seek(self.span.inside(to))
            case Rate(rate):
                self.change_rate(rate)
            case Stop():
                self.stop()
            case _:
                raise AdsError(ADS_E_SRVNOTSUPP)

    def _at_ns(self) -> int:
        """Where it is: the replay time, but not beyond an event that is still to be played."""
        return min(self._pace.now_ns, self._next_ns) if self._goal_ns is None else self._goal_ns

    @property
    def running(self) -> bool:
        """Whether time goes on, rather than stands still."""
        return self._pace.running

    @property
    def now_ns(self) -> int:
        """The replay time."""
        with self._news:
            return self._at_ns()

    def status(self) -> Facts:
        """What it does now, as facts for people and programs."""
        with self._news:
            at_ns = self._at_ns()
            return {
                "state": self._state,
                "at": time_text(at_ns, 3),
                "offset_s": self.span.offset_s(at_ns),
                "length_s": self.span.offset_s(self.span.last_ns),
                "rate": self._pace.rate,
                "events": self.report.events,
                "of": self.span.events,
                "loop": self._loop,
                "rounds": self._rounds,
            }

    # Playing: on our thread.

    def _run(self) -> None:
        state: PlayerState = "failed"
        try:
            at_ns: int | None = self._start_ns
            while at_ns is not None:
                played = self._play(at_ns)
                at_ns = self._next_start(played or at_ns != self._start_ns)  # one may go behind all there is to play
            if not self._stopped:
                self._stage.flush()
            state = "ended"
        except Exception as error:  # noqa: BLE001 - close() raises it
            if not self._stopped:  # else the bus was taken away from a send that waited for it
                self.error = error
        finally:
            with self._news:
                self._state = state
                self._news.notify_all()

    def _next_start(self, played: bool) -> int | None:
        """Where to go on after a run; None at the end. A round in which nothing was played would go on for ever."""
        with self._news:
            if self._stopped:
                return None
            if self._goal_ns is not None:
                goal_ns, self._goal_ns = self._goal_ns, None
                return goal_ns
            if not (self._loop and played):
                return None
            self._rounds += 1
            return self._start_ns

    def _play(self, at_ns: int) -> bool:
        """Play from a moment to the end, or until told otherwise; whether anything was played."""
        try:
            scene = standing_at(self._paths, at_ns - 1, on_progress=self._look)
        except _ElsewhereError:
            return False
        self.report.truncated |= bool(scene.damages)
        items = entries(self._paths, Part(start_ns=at_ns, end_ns=self._end_ns), self.report)
        played = entered = False
        try:
            for item in items:
                if self._is_wanted_elsewhere():
                    return played
                if isinstance(item, RecordedState):
                    if scene.state(item.state) and entered:  # a gap hid what the keyframe tells
                        if not self._until(item.log_time_ns, steps=0):
                            return played
                        self._show(scene, item.state.target)
                    continue
                if not entered:
                    entered = True
                    self._enter(scene, at_ns)
                event = self._taken(scene, item)
                if event is None:
                    continue
                if not self._until(item.log_time_ns):
                    return played
                self._stage.send(event)
                played = True
                self._count(item.log_time_ns)
            if not entered:
                self._enter(scene, at_ns)
            if (
                self._loop and played
            ) or not self._pace.running:  # the round ends with its last second; paused, one may go back
                self._until(self._last_ns(), end=True)
            return played
        finally:
            items.close()

    def _last_ns(self) -> int:
        return self.span.last_ns if self._end_ns is None else min(self._end_ns, self.span.last_ns)

    def _enter(self, scene: Standing, at_ns: int) -> None:
        """Everybody on stage, with the alarms there are now; then the time starts."""
        for target in self._targets.keys() | {frame.target for frame in scene.frames()}:
            self._show(scene, target)
        with self._news:
            self._next_ns = at_ns
            self._pace.jump(at_ns)
            self._state = "waiting" if self._patience_s else self._moving()
        deadline = time.monotonic() + self._patience_s
        while time.monotonic() < deadline and not self._stopped and not self._stage.is_heard():
            time.sleep(0.01)
        self._patience_s = 0.0
        with self._news:
            self._pace.jump(at_ns)
            if self._goal_ns is None:
                self._state = self._moving()

    def _moving(self) -> PlayerState:
        return "playing" if self._pace.running or self._steps else "paused"

    def _show(self, scene: Standing, target: str) -> None:
        goal = self._targets.setdefault(target, self._remap.get(target, target))
        alarms = [alarm for frame in scene.frames(target) for alarm in replayed_frame(frame, goal).alarms]
        self._stage.enter(goal, filter_alarms(alarms, self._matches))

    def _is_wanted_elsewhere(self) -> bool:
        return self._stopped or self._goal_ns is not None

    def _look(self, _read: int) -> None:
        if self._is_wanted_elsewhere():
            raise _ElsewhereError

    def _taken(self, scene: Standing, item: RecordedEvent) -> AnyEvent | None:
        """The event to send, if it is one that the filter takes; the scene follows all of them."""
        event = item.event
        if not isinstance(event, MessageSent):
            scene.event(item.realm, event)
        if self._matches is not None and not self._matches(event):
            self.report.filtered_out += 1
            return None
        target = self._targets[event.target]
        return msgspec.structs.replace(event, target=target, origin=origin_of(event, item.realm))

    def _until(self, log_ns: int, *, steps: int = 1, end: bool = False) -> bool:
        """Wait until an entry that takes so many steps is due, or until the end is; False when it is not to be played."""
        with self._news:
            self._next_ns = log_ns
            while not self._is_wanted_elsewhere():
                if self._steps:
                    self._steps = 0 if end else self._steps - steps
                    if not self._steps:
                        self._state = "paused"
                    if not end:
                        self._pace.play(log_ns)
                        return True
                left_s = self._pace.left_s(log_ns)
                if left_s <= 0:
                    self._pace.play(log_ns)
                    return True
                if self._pace.running:
                    self._wait(self._news, min(left_s, _LOOK_S))
                else:
                    self._news.wait()
            return False

    def _count(self, log_ns: int) -> None:
        report = self.report
        report.events += 1
        report.first_ns = report.first_ns or log_ns
        report.last_ns = log_ns
        if self._on_progress is not None and report.events % PROGRESS_EVENTS == 0:
            self._on_progress(report)

    # Ending.

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until it has ended; False when the time is up first."""
        with self._news:
            return self._news.wait_for(lambda: self._state in ("ended", "failed"), timeout_s)

    def close(self, timeout_s: float = 2.0) -> ReplayReport:
        """Stop, and take the replay off the bus: its alarms are gone with it. What went wrong while playing is raised here."""
        self.stop()
        self._thread.join(timeout_s)
        self.control.close()
        self.report.unsent = self._stage.close(timeout_s)
        if self.error is not None:
            raise self.error
        return self.report

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
