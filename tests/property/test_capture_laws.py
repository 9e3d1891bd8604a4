"""Captures against a model: for any stream of events and triggers, files hold exactly the events of their windows."""

from hypothesis import given, settings
from hypothesis import strategies as st

from bridge.core.events import Severity
from bridge.notices import Heard
from bridge.recorder.capture import Capture, Windows
from tests.unit.recorder.recorder_stories import START, Notebook, S, heard, message

steps = st.lists(st.tuples(st.integers(0, 40), st.booleans()), max_size=60)


@settings(max_examples=300)
@given(steps, st.integers(0, 30), st.integers(0, 30), st.data())
def test_files_hold_exactly_the_events_of_their_windows(
    stream: list[tuple[int, bool]], before: int, after: int, data: st.DataObject
) -> None:
    """Windows that overlap are one, an event is in the file of its window and in no other, and the rest is in none."""
    out = Notebook()
    windows = Windows(
        Capture(trigger="severity = critical", before_s=before, after_s=after),
        lambda event: event.severity is Severity.CRITICAL,
        out,
    )
    now, times, merged = 0, [], list[list[int]]()
    for number, (pause, is_trigger) in enumerate(stream):
        if data.draw(st.booleans()):
            windows.tick(START + now * S)
        now += pause
        times.append(now)
        severity = Severity.CRITICAL if is_trigger else Severity.INFO
        windows.take(heard(message(number, severity), now), START + now * S)
        if is_trigger:
            if merged and now - before <= merged[-1][1]:
                merged[-1][1] = now + after
            else:
                merged.append([now - before, now + after])
    windows.end()
    wanted = [[number for number, at in enumerate(times) if first <= at <= last] for first, last in merged]
    assert [window.events for window in out.windows] == wanted
    for window, (first, _) in zip(out.windows, merged, strict=True):
        earlier = [number for number, at in enumerate(times) if at < first]
        passed = [item.event.event_id for item in out.passed[: window.passed] if isinstance(item, Heard)]
        assert passed == earlier
        assert [at_ns for _, at_ns in window.items] == [START + times[number] * S for number in window.events]
