"""Trigger capture with real programs: files around triggers, and nothing else."""

import time
from pathlib import Path

from bridge import BusConfig, EventLogger, Severity, open_bus
from bridge.control import present
from bridge.core.events import MessageSent
from bridge.edges.recording import RecordedEvent, RecordedState, leftovers, read_events, summary
from tests.e2e.fault_stories import CLASS, eventually, program

BEFORE_S, AFTER_S = 0.8, 0.5
TRIGGERS_S = (1.5, 2.2, 5.0)
"""The second one's window begins before the first one's has ended; the third is on its own."""
RUN_S = 6.2
LATE_NS = 400_000_000
"""How long an event may take from its sender to the recorder on a busy machine."""


def run(logger: EventLogger) -> dict[int, int]:
    """Messages each 5 ms with numbers that follow each other, three of them critical; when each was sent.

    Between the second and the third the alarm that is there is cleared and another one raised.
    """
    (early,) = logger.active_alarms()
    late = logger.create_alarm(CLASS, 2, Severity.ERROR).alarm
    assert late is not None
    sent: dict[int, int] = {}
    triggers = list(TRIGGERS_S)
    started_s = time.monotonic()
    swapped = False
    while (now_s := time.monotonic() - started_s) < RUN_S:
        if not swapped and now_s > 3.2:
            logger.raise_alarm(late)
            logger.clear_alarm(early)
            swapped = True
        is_trigger = bool(triggers) and now_s >= triggers[0]
        if is_trigger:
            triggers.pop(0)
        number = 100 + len(sent)
        sent[number] = time.time_ns()
        logger.send_message(CLASS, number, Severity.CRITICAL if is_trigger else Severity.INFO)
        time.sleep(0.005)
    assert triggers == []
    return sent


def check(path: Path, sent: dict[int, int], triggers: int, alarms: dict[int, bool]) -> None:
    """The file begins with the state, and has the events of its window, each once and no other."""
    items = list(read_events(path))
    first = items[0]
    assert isinstance(first, RecordedState)
    assert {alarm.event_id: alarm.raised for alarm in first.state.alarms} == alarms
    assert sum(isinstance(item, RecordedState) for item in items) == 1
    events = [item for item in items if isinstance(item, RecordedEvent) and isinstance(item.event, MessageSent)]
    numbers = [item.event.event_id for item in events]
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    fired = [item.log_time_ns for item in events if item.event.severity is Severity.CRITICAL]
    assert len(fired) == triggers
    from_ns, to_ns = fired[0] - round(BEFORE_S * 1e9), fired[-1] + round(AFTER_S * 1e9)
    assert from_ns <= events[0].log_time_ns
    assert events[-1].log_time_ns <= to_ns
    # Its neighbours came outside the window: one was sent before it began, the other not long before it ended.
    assert sent[numbers[0] - 1] < from_ns
    assert sent[numbers[0]] > from_ns - LATE_NS
    assert sent[numbers[-1] + 1] > to_ns - LATE_NS
    assert summary(path).complete == "yes"


def test_three_triggers_of_which_two_overlap_make_two_files(bus_config: BusConfig, tmp_path: Path) -> None:
    """Each with exactly the events of its windows, and a keyframe of the alarms as they were when it begins."""
    folder = tmp_path / "faults"
    command = ["record", str(folder), "--json", "--trigger", "severity = critical"]
    command += ["--before", str(BEFORE_S), "--after", str(AFTER_S), "--scouting-group", bus_config.scouting_group]
    with open_bus(bus_config) as bus, EventLogger("plc1", bus=bus) as logger:
        alarm = logger.create_alarm(CLASS, 1, Severity.ERROR).alarm
        assert alarm is not None
        logger.raise_alarm(alarm)
        with program(*command) as recorder:
            assert eventually(lambda: [one.name for one in present(bus)] == ["faults"])
            sent = run(logger)
            assert eventually(lambda: len(list(folder.glob("*.mcap"))) == 2)
            assert leftovers(folder) == []
            told = [recorder.line() for _ in range(4)]
    first, second = sorted(folder.glob("*.mcap"))
    check(first, sent, 2, {1: True})
    check(second, sent, 1, {1: False, 2: True})
    assert [line.partition(":")[0] for line in told] == ['{"began"', '{"finished"'] * 2
