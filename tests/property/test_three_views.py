"""Live logger, mirror fed from the bus and fresh book fed from the recording hold the same state, whatever was commanded."""

import tempfile
from pathlib import Path

import hypothesis.strategies as st
import msgspec
from hypothesis import HealthCheck, settings
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from bridge import AdsError, AlarmKey, ConfirmationState, Recorder, Severity, Source, open_bus
from bridge.core.alarms import AlarmTable, fold
from bridge.core.hresult import ADS_E_INVALIDSTATE, ADS_E_NOTFOUND
from bridge.core.questions import LogQuestion
from bridge.edges.bus import ALONE
from bridge.logger import Book, EventLogger, Mirror
from bridge.replayer import replay_into

CLASSES = ("54cc5482-ad79-4cdc-8c3e-b3983b36ed66", "0a1b2c3d-0000-4000-8000-000000000001")
KEYS = [
    AlarmKey("plc1", event_class, event_id, source_id, source_name, None)
    for event_class in CLASSES
    for event_id in (1, 2)
    for source_id, source_name in ((None, None), (0, ""), (7, "MAIN.fbAxis"))
]
START_NS = 1_795_300_000_000_000_000

some_key = st.sampled_from(KEYS)
some_time = st.sampled_from([0, 0, START_NS - 10**9, START_NS + 10**12])
some_arguments = st.sampled_from([None, (), (1, "two", 3.0)])
some_json = st.sampled_from([None, "", '{"axis":3}', "not json"])


class ThreeViews(RuleBasedStateMachine):
    """Commands in any order, refused ones too; the three views are compared when the run ends."""

    def __init__(self) -> None:
        super().__init__()
        self.now_ns = START_NS
        self.folder = tempfile.TemporaryDirectory()
        self.path = Path(self.folder.name) / "run.mcap"
        self.bus = open_bus(ALONE)
        self.target = "plc1"
        self.recorder = Recorder(self.bus, self.path, clock=self.clock)
        self.mirror = Mirror(self.bus, self.target, clock=self.clock)
        self.logger = EventLogger(self.target, bus=self.bus, clock=self.clock)

    def clock(self) -> int:
        self.now_ns += 1000
        return self.now_ns

    @initialize()
    def listening(self) -> None:
        assert self.recorder.listener.wait_for_beat(self.logger.session)

    def refused(self, error: AdsError) -> None:
        assert error.code in (ADS_E_INVALIDSTATE, ADS_E_NOTFOUND)

    @rule(key=some_key, severity=st.sampled_from(Severity), confirm=st.booleans(), json=some_json)
    def create(self, key: AlarmKey, severity: Severity, confirm: bool, json: str | None) -> None:
        known = key in self.logger.book.alarms
        answer = self.logger.create_alarm(
            key.event_class,
            key.event_id,
            severity,
            with_confirmation=confirm,
            source=self.source_of(key),
            json_attribute=json or "",
        )
        assert answer.created is not known

    @staticmethod
    def source_of(key: AlarmKey) -> Source:
        return Source(key.source_id, key.source_name, key.source_guid)

    @rule(key=some_key, time_ns=some_time, arguments=some_arguments, json=some_json)
    def raise_(self, key: AlarmKey, time_ns: int, arguments: tuple[int | str | float, ...] | None, json: str | None) -> None:
        try:
            alarm = self.logger.raise_alarm(key, time_ns=time_ns, arguments=arguments, json_attribute=json)
        except AdsError as error:
            self.refused(error)
        else:
            assert alarm.raised
            assert time_ns in (0, alarm.time_raised_ns)

    @rule(key=some_key, time_ns=some_time, reset=st.booleans())
    def clear(self, key: AlarmKey, time_ns: int, reset: bool) -> None:
        try:
            alarm = self.logger.clear_alarm(key, time_ns=time_ns, reset_confirmation=reset)
        except AdsError as error:
            self.refused(error)
        else:
            assert not alarm.raised
            assert not (reset and alarm.confirmation_state is ConfirmationState.WAIT_FOR_CONFIRMATION)

    @rule(key=some_key, comment=st.sampled_from(["", "seen"]))
    def confirm(self, key: AlarmKey, comment: str) -> None:
        try:
            alarm = self.logger.confirm_alarm(key, operator="night shift", comment=comment)
        except AdsError as error:
            self.refused(error)
        else:
            assert alarm.confirmation_state is ConfirmationState.CONFIRMED

    @rule(key=some_key)
    def dispose(self, key: AlarmKey) -> None:
        try:
            self.logger.dispose_alarm(key)
        except AdsError as error:
            self.refused(error)

    @rule(event_id=st.integers(0, 3))
    def message(self, event_id: int) -> None:
        self.logger.send_message(CLASSES[0], event_id, Severity.INFO)

    def teardown(self) -> None:
        try:
            session, seq = self.logger.session, self.logger.publisher.seq
            assert self.mirror.wait_for(session, seq)
            live = AlarmTable()
            live.load(self.logger.book.alarms.values())
            assert self.mirror.table.state() == live.state()
            self.recorder.close()
            with Book(None) as book:
                report = replay_into([self.path], book)
                assert report.events == seq
                assert report.gaps == report.rejected == 0
                book.flush()
                assert book.logbook.table.state() == live.state()
                replayed = [stored.event for stored in book.log(LogQuestion(newest_first=False))]
            stored = [stored.event for stored in self.logger.log(LogQuestion(newest_first=False))]
            assert all(event.origin is not None for event in replayed)
            unmarked = [msgspec.structs.replace(event, origin=None) for event in replayed]
            assert sorted(unmarked, key=lambda event: event.seq) == stored
            assert fold(stored).state() == live.state()
        finally:
            self.mirror.close()
            self.logger.close()
            self.bus.close()
            self.folder.cleanup()


ThreeViews.TestCase.settings = settings(
    max_examples=300, stateful_step_count=40, deadline=None, suppress_health_check=list(HealthCheck)
)
TestThreeViews = ThreeViews.TestCase
