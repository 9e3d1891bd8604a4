"""A recording on the bus: at its pace, from any place, told what to do, and with the state that it had there."""

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from bridge import AdsError, EventLogger, Listener, LoggerProxy, Severity, open_bus
from bridge.control import NameTakenError, tell
from bridge.core import keys
from bridge.core.alarms import fold
from bridge.core.control import Pause, Rate, Resume, Seek, Split, Status, Step, Stop
from bridge.core.events import AnyEvent, Event
from bridge.core.filters.text import parse
from bridge.core.hresult import ADS_E_INVALIDACCESS, ADS_E_INVALIDPARM, ADS_E_INVALIDSTATE, ADS_E_SRVNOTSUPP
from bridge.core.times import NS_PER_S
from bridge.edges.bus import ALONE, Bus
from bridge.edges.recording import Gap, RecordingError, Standing, StateFrame
from bridge.listener import LoggerGone
from bridge.logger import Mirror, TargetTakenError
from bridge.publisher import PublisherClosedError
from bridge.replayer import LoggerThereError, Player, RemapError
from bridge.replayer import player as player_module
from bridge.replayer.stage import Stage
from bridge.testing.builders import EVENT_CLASS, TARGET, alarm_raised, message_sent
from tests.unit.replayer.player_stories import (
    SESSION,
    START_NS,
    HandClock,
    eventually,
    frame_of,
    night,
    numbered,
    record,
    state_is,
)


@pytest.fixture
def bus() -> Iterator[Bus]:
    """A bus that nobody else is on."""
    with open_bus(ALONE) as alone:
        yield alone


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "night.mcap"


def in_order(events: list[AnyEvent]) -> list[AnyEvent]:
    """As they were sent: between keys the bus promises no order, and a later session has a greater id."""
    return sorted(events, key=lambda event: (event.session, event.seq))


def ids(events: list[AnyEvent]) -> list[int]:
    return [event.event_id for event in in_order(events)]


def raised(listener: Listener) -> dict[int, bool]:
    return {alarm.event_id: alarm.raised for alarm in listener.alarms}


def test_a_replay_is_marked_and_keeps_to_its_realm(bus: Bus, path: Path) -> None:
    """New numbers, the old ones in origin; nobody in realm live hears it."""
    events = night(path)
    with Listener(bus) as live, Listener(bus, realm="replay-test", on_full="wait") as listener:
        with Player(bus, [path], realm="replay-test", rate=0, wait_for_listener_s=30) as player:
            got = in_order(listener.take(10))
            assert player.wait(30)
            assert player.close().unsent == 0
        assert live.get(0) is None
    assert ids(got) == ids(events)
    origins = [event.origin for event in got]
    assert [(each.realm, each.session, each.seq, each.key_seq) for each in origins if each is not None] == [
        ("live", SESSION, event.seq, event.key_seq) for event in events
    ]
    assert {event.session for event in got}.isdisjoint({SESSION})
    assert [event.seq for event in got] == list(range(1, 11))


def test_each_replay_has_a_realm_of_its_own(bus: Bus, path: Path) -> None:
    """Its name for control is that of the realm, unless another is given."""
    night(path)
    with Player(bus, [path], paused=True) as one, Player(bus, [path], paused=True) as other:
        assert one.realm.startswith("replay-")
        assert one.realm != other.realm
        assert one.control.name == one.realm
    with Player(bus, [path], realm="test", paused=True) as third:
        assert third.control.name == "replay-test"


@pytest.mark.parametrize("rate", [1.0, 2.0, 0.5])
def test_the_pace_is_that_of_the_recording_times_the_rate(bus: Bus, path: Path, rate: float) -> None:
    """By the clock that was handed in: nine seconds of recording take nine seconds, divided by the rate."""
    night(path)
    clock = HandClock()
    with Player(bus, [path], rate=rate, clock_s=clock, wait=clock.wait) as player:
        assert player.wait(30)
    assert clock.waited_s == pytest.approx(9 / rate, abs=1e-6)


def test_as_fast_as_it_can_waits_for_no_time(bus: Bus, path: Path) -> None:
    """Rate 0 asks the clock for nothing."""
    night(path)
    clock = HandClock()
    with Player(bus, [path], rate=0, clock_s=clock, wait=clock.wait) as player:
        assert player.wait(30)
        assert player.report.events == 10
    assert clock.waited_s == 0


@pytest.mark.parametrize("rate", [-1.0, float("nan"), float("inf"), 1e308])
def test_a_wrong_rate_is_refused(bus: Bus, path: Path, rate: float) -> None:
    """At the call; nothing is on the bus then."""
    night(path)
    with pytest.raises(ValueError, match="rate"):
        Player(bus, [path], rate=rate)
    with Player(bus, [path], paused=True) as player, pytest.raises(ValueError, match="rate"):
        player.change_rate(rate)


def test_what_is_no_recording_is_refused(bus: Bus, tmp_path: Path) -> None:
    """At the call too."""
    (tmp_path / "x.mcap").write_bytes(b"no recording")
    with pytest.raises(RecordingError):
        Player(bus, [tmp_path / "x.mcap"])


def test_a_part_is_played_with_the_state_before_it(bus: Bus, path: Path) -> None:
    """From 5 s up to 8 s: the two alarms raised before are there from the start, and their origin says from where."""
    night(path)
    with (
        Listener(bus, realm="r", with_state=True, on_full="wait") as listener,
        Player(
            bus,
            [path],
            realm="r",
            rate=0,
            paused=True,
            start_ns=START_NS + 5 * NS_PER_S,
            end_ns=START_NS + 8 * NS_PER_S,
            wait_for_listener_s=30,
        ) as player,
    ):
        eventually(lambda: raised(listener) == {1: True, 2: True})
        assert {alarm.event_id: alarm.origin.seq for alarm in listener.alarms if alarm.origin is not None} == {1: 3, 2: 5}
        player.resume()
        assert ids(listener.take(3)) == [105, 1, 107]
        assert player.wait(30)
        assert player.report.events == 3
        assert raised(listener) == {2: True}


def test_who_joins_late_has_the_state(bus: Bus, path: Path) -> None:
    """As from a logger: listeners with state, mirrors, the proxy."""
    night(path)
    with Player(bus, [path], realm="r", rate=0, paused=True) as player:
        player.step(5)
        state_is(player, "paused")
        with Listener(bus, realm="r", with_state=True) as late, Mirror(bus, TARGET, realm="r") as mirror:
            assert raised(late) == {1: True, 2: True}
            assert {alarm.event_id for alarm in mirror.alarms} == {1, 2}
            proxy = LoggerProxy(bus, TARGET, realm="r")
            assert [alarm.event_id for alarm in proxy.active_alarms()] == [1, 2]
            player.step(2)
            eventually(lambda: raised(late) == {2: True})


def test_a_replay_takes_no_commands(bus: Bus, path: Path) -> None:
    """ADS_E_INVALIDACCESS for each, and for clearing the log; the alarm stays. A logger of the name is refused."""
    night(path)
    with Player(bus, [path], realm="r", rate=0, paused=True) as player:
        player.step(5)
        state_is(player, "paused")
        proxy = LoggerProxy(bus, TARGET, realm="r")
        (first, _) = proxy.active_alarms()
        for command in (proxy.confirm_alarm, proxy.clear_alarm, proxy.raise_alarm, proxy.dispose_alarm):
            with pytest.raises(AdsError, match="plc1 in realm r is a replay") as refused:
                command(first)
            assert refused.value.code == ADS_E_INVALIDACCESS
        with pytest.raises(AdsError, match="is a replay"):
            proxy.create_alarm(EVENT_CLASS, 9, Severity.INFO)
        with pytest.raises(AdsError, match="is a replay"):
            proxy.clear_log()
        with pytest.raises(RuntimeError, match="replay, which keeps no log"):
            list(proxy.log())
        assert [alarm.event_id for alarm in proxy.active_alarms()] == [1, 2]
        with pytest.raises(TargetTakenError):
            EventLogger(TARGET, bus=bus, realm="r")


def test_a_replay_next_to_a_logger_of_its_target_is_refused(bus: Bus, path: Path) -> None:
    """In that realm; renamed, or in a realm of its own, it plays."""
    night(path)
    with EventLogger(TARGET, bus=bus):
        with pytest.raises(LoggerThereError, match="realm live has a logger of 'plc1'"):
            Player(bus, [path], realm="live")
        Player(bus, [path], realm="live", remap={TARGET: "test1"}, paused=True).close()
        Player(bus, [path], paused=True).close()


def test_a_name_is_one_players(bus: Bus, path: Path) -> None:
    """A second replay into the same realm is refused, so two never mix."""
    night(path)
    with Player(bus, [path], realm="r", paused=True), pytest.raises((NameTakenError, LoggerThereError)):
        Player(bus, [path], realm="r", paused=True)


def test_targets_are_renamed(bus: Bus, path: Path) -> None:
    """Events and alarms, with the state at the start; a name that is not there, or two that become one, are refused."""
    two: list[AnyEvent] = [message_sent(), alarm_raised(target="plc2"), message_sent(target="plc2")]
    record(path, numbered(two))
    with (
        Listener(bus, realm="r", with_state=True, on_full="wait") as listener,
        Player(
            bus, [path], realm="r", rate=0, start_ns=START_NS + 2 * NS_PER_S, remap={"plc2": "test2"}, wait_for_listener_s=30
        ),
    ):
        (event,) = listener.take(1)
        assert event.target == "test2"
        eventually(lambda: [alarm.target for alarm in listener.alarms] == ["test2"])
    with pytest.raises(RemapError, match="plc9: not in the recording, which has plc1, plc2"):
        Player(bus, [path], remap={"plc9": "x"})
    with pytest.raises(RemapError, match="plc1 and plc2 would both be plc2"):
        Player(bus, [path], remap={"plc1": "plc2"})


def test_a_filter_chooses_events_and_alarms(bus: Bus, path: Path) -> None:
    """The rest is counted; an alarm of the state is there if the filter takes it."""
    night(path)
    with (
        Listener(bus, realm="r", with_state=True, on_full="wait") as listener,
        Player(
            bus,
            [path],
            parse("event_id in (2, 107)"),
            realm="r",
            rate=0,
            start_ns=START_NS + 5 * NS_PER_S,
            wait_for_listener_s=30,
        ) as player,
    ):
        assert ids(listener.take(1)) == [107]
        assert player.wait(30)
        eventually(lambda: raised(listener) == {2: True})
    assert player.report.filtered_out == 4


def test_pause_step_resume(bus: Bus, path: Path) -> None:
    """Paused, nothing comes; a step plays so many; resumed, it goes on where it was and no time has passed."""
    night(path)
    clock = HandClock()
    with (
        Listener(bus, realm="r", on_full="wait") as listener,
        Player(bus, [path], realm="r", paused=True, wait_for_listener_s=30, clock_s=clock, wait=clock.wait) as player,
    ):
        state_is(player, "paused")
        assert player.status()["events"] == 0
        player.step()
        assert ids(listener.take(1)) == [100]
        player.step(3)
        assert ids(listener.take(3)) == [101, 1, 103]
        state_is(player, "paused")
        assert player.status()["offset_s"] == 3.0
        assert player.now_ns == START_NS + 3 * NS_PER_S
        clock.now_s += 1000
        player.resume()
        assert len(listener.take(6)) == 6
        assert player.wait(30)
    assert clock.waited_s == pytest.approx(6, abs=1e-6)


def test_seek_rebuilds_the_state_in_both_directions(bus: Bus, path: Path) -> None:
    """Listeners see another session of the logger, and the alarms of that moment."""
    night(path)
    with Listener(bus, realm="r", with_state=True, on_full="wait") as listener:
        with Player(bus, [path], realm="r", rate=0, paused=True, wait_for_listener_s=30) as player:
            player.step(7)
            eventually(lambda: raised(listener) == {2: True})
            for second, alarms in ((3, {1: True}), (5, {1: True, 2: True}), (0, {}), (9, {2: True})):
                player.seek(START_NS + second * NS_PER_S)
                state_is(player, "paused")
                eventually(lambda alarms=alarms: raised(listener) == alarms)  # type: ignore[misc]
                assert player.status()["offset_s"] == second
            player.resume()
            assert player.wait(30)
        eventually(lambda: listener.counters.passed == 7 + 1)
    items = list(listener)
    assert next(item.event_id for item in reversed(items) if isinstance(item, Event)) == 109
    assert all(item.clean for item in items if isinstance(item, LoggerGone))
    assert listener.counters.missing == listener.counters.tails_unknown == 0


def test_a_loop_starts_over_with_the_state_of_the_start(bus: Bus, path: Path) -> None:
    """Every round is the same, and lasts until the last second; it ends when stopped."""
    night(path)
    clock = HandClock()
    with (
        Listener(bus, realm="r", on_full="wait") as listener,
        Player(
            bus,
            [path],
            realm="r",
            loop=True,
            start_ns=START_NS + 5 * NS_PER_S,
            end_ns=START_NS + 9 * NS_PER_S,
            wait_for_listener_s=30,
            clock_s=clock,
            wait=clock.wait,
        ) as player,
    ):
        got = listener.take(12, timeout_s=60)
        assert ids(got) == [105, 1, 107, 108] * 3
        player.stop()
        assert player.wait(30)
        rounds = int(player.status()["rounds"])
        assert rounds >= 2
    assert len({event.session for event in got}) == 3
    assert clock.waited_s >= 4 * rounds - 1


def test_a_loop_in_which_nothing_is_played_ends(bus: Bus, path: Path) -> None:
    """Else it would read the file for ever."""
    night(path)
    with Player(bus, [path], parse("event_id = 7"), loop=True, rate=0) as player:
        assert player.wait(30)


def test_a_keyframe_after_a_gap_makes_the_state_right(bus: Bus, path: Path) -> None:
    """Events that are missing are missing, but the alarms are those that there were."""
    events = numbered(
        [alarm_raised(event_id=1), alarm_raised(event_id=2), message_sent(event_id=103), message_sent(event_id=104)]
    )
    gap = Gap(session=SESSION, key="", first_key_seq=2, last_key_seq=2, count=1, reason="lost")
    record(path, [events[0], events[2], gap, frame_of(fold(events[:3]), 3), events[3]])
    with (
        Listener(bus, realm="r", with_state=True, on_full="wait") as listener,
        Player(bus, [path], realm="r", rate=0, wait_for_listener_s=30) as player,
    ):
        assert ids(listener.take(3)) == [1, 103, 104]
        assert player.wait(30)
        eventually(lambda: raised(listener) == {1: True, 2: True})
    assert (player.report.gaps, player.report.missing) == (1, 1)


def test_a_keyframe_is_shown_when_its_time_has_come(bus: Bus, path: Path) -> None:
    """Not before: who stands still before it has the state of that moment; it is no step of its own."""
    events = numbered([alarm_raised(event_id=1), alarm_raised(event_id=2), message_sent(event_id=103)])
    gap = Gap(session=SESSION, key="", first_key_seq=2, last_key_seq=2, count=1, reason="lost")
    record(path, [events[0], gap, frame_of(fold(events[:2]), 2), events[2]])
    with (
        Listener(bus, realm="r", with_state=True, on_full="wait") as listener,
        Player(bus, [path], realm="r", paused=True, wait_for_listener_s=30) as player,
    ):
        player.step()
        assert ids(listener.take(1)) == [1]
        state_is(player, "paused")
        eventually(lambda: player._next_ns == START_NS + 2 * NS_PER_S)
        eventually(lambda: raised(listener) == {1: True})
        assert [alarm.event_id for alarm in player._stage._there[TARGET]._book.table.alarms.values()] == [1]
        player.step()
        assert ids(listener.take(1)) == [103]
        eventually(lambda: raised(listener) == {1: True, 2: True})


def test_a_logger_of_which_only_a_keyframe_tells_is_a_target(bus: Bus, path: Path) -> None:
    """No other is renamed to it, and its replay is refused where its logger is."""
    (event,) = numbered([message_sent()])
    quiet = StateFrame(realm="live", target="quiet", session="s9", seq=1, alarms=())
    record(path, [quiet, event])
    with pytest.raises(RemapError):
        Player(bus, [path], remap={TARGET: "quiet"})
    with Player(bus, [path], remap={"quiet": "loud"}) as player:
        assert player.wait(30)
    with EventLogger("quiet", bus=bus), pytest.raises(LoggerThereError):
        Player(bus, [path], realm="live")


def test_who_closes_a_player_that_looks_for_a_state_leaves_nobody_on_stage(
    bus: Bus, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Closing does not wait for the reading to end; what comes later enters no more."""
    night(path)
    looks, goes_on = threading.Event(), threading.Event()

    def slow(*_given: object, **_more: object) -> Standing:
        looks.set()
        assert goes_on.wait(60)
        return Standing()

    monkeypatch.setattr(player_module, "standing_at", slow)
    player = Player(bus, [path], realm="r", start_ns=START_NS + 5 * NS_PER_S)
    assert looks.wait(30)
    player.close(timeout_s=0.05)
    goes_on.set()
    assert player.wait(30)
    assert bus.who_is_alive(keys.verb_key("r", None, "@alive", "logger", None), timeout_s=0.5) == set()


def test_a_loop_goes_on_from_behind_all_there_is_to_play(bus: Bus, path: Path) -> None:
    """Who goes to the end of a loop comes to its start."""
    night(path)
    with (
        Listener(bus, realm="r", on_full="wait") as listener,
        Player(
            bus, [path], realm="r", loop=True, paused=True, rate=0, end_ns=START_NS + 3 * NS_PER_S, wait_for_listener_s=30
        ) as player,
    ):
        state_is(player, "paused")
        player.seek(START_NS + 8 * NS_PER_S)
        state_is(player, "paused")
        player.resume()
        assert ids(listener.take(3)) == [100, 101, 1]


def test_a_recording_that_starts_with_alarms_has_them(bus: Bus, path: Path) -> None:
    """The keyframe at its start is the state before the first event; also when nothing else is in the file."""
    (event,) = numbered([alarm_raised(event_id=1)])
    record(path, [frame_of(fold([event]), 1)])
    with Player(bus, [path], realm="r", paused=True) as player:
        state_is(player, "paused")
        with Listener(bus, realm="r", with_state=True) as listener:
            assert raised(listener) == {1: True}


def test_several_files_are_one_recording(bus: Bus, tmp_path: Path) -> None:
    """By time, whatever their order; what two of them hold is played once."""
    events = numbered([message_sent(event_id=100 + number) for number in range(4)])
    one, other = record(tmp_path / "a.mcap", events[:3]), record(tmp_path / "b.mcap", events)
    with (
        Listener(bus, realm="r", on_full="wait") as listener,
        Player(bus, [other, one], realm="r", rate=0, wait_for_listener_s=30) as player,
    ):
        assert ids(listener.take(4)) == [100, 101, 102, 103]
        assert player.wait(30)
        assert player.report.events == 4


def test_it_is_told_over_the_bus(bus: Bus, path: Path) -> None:
    """Pause, step, seek, rate, resume, stop: each answered with the status."""
    night(path)
    with Player(bus, [path], realm="r", name="night", rate=0, paused=True) as player:
        state_is(player, "paused")

        def told(command: Step | Seek | Rate | Pause | Resume | Stop | Status) -> dict[str, str | int | float | bool]:
            return tell(bus, "night", command, realm="r").status

        told(Step(3))
        eventually(lambda: told(Status())["events"] == 3)
        told(Seek("7.5"))
        eventually(lambda: told(Status())["offset_s"] == 7.5)
        told(Seek("2026-11-22T08:00:01Z"))
        eventually(lambda: told(Status())["offset_s"] == 1.0)
        assert told(Rate(0.001))["rate"] == 0.001
        assert told(Resume())["state"] == "playing"
        assert told(Pause())["state"] == "paused"
        for wrong in ("never", "-1", "nan", "3600", "2026-11-21T00:00:00Z"):
            with pytest.raises(AdsError) as refused:
                told(Seek(wrong))
            assert refused.value.code == ADS_E_INVALIDPARM
        with pytest.raises(AdsError) as unknown:
            tell(bus, "night", Split(), realm="r")
        assert unknown.value.code == ADS_E_SRVNOTSUPP
        told(Stop())
        assert player.wait(30)
        with pytest.raises(AdsError) as over:
            told(Pause())
        assert over.value.code == ADS_E_INVALIDSTATE


def test_events_without_a_time_get_the_replay_time(bus: Bus, path: Path) -> None:
    """What waits or stamps runs on replay time."""
    record(path, numbered([message_sent(time_ns=0), message_sent(time_ns=0)]))
    clock = HandClock()
    with Listener(bus, realm="r", on_full="wait") as listener:
        with Player(bus, [path], realm="r", wait_for_listener_s=30, clock_s=clock, wait=clock.wait) as player:
            assert player.wait(30)
        assert [event.time_ns for event in in_order(listener.take(2))] == [START_NS, START_NS + NS_PER_S]


def test_a_replay_that_waits_for_the_bus_ends_when_told(bus: Bus, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its send is given up with the publisher; that is no error of the replay."""
    night(path)
    waiting, given_up = threading.Event(), threading.Event()

    def send(_stage: Stage, _event: AnyEvent) -> None:
        waiting.set()
        assert given_up.wait(30)
        raise PublisherClosedError("closed while waiting")

    monkeypatch.setattr(Stage, "send", send)
    player = Player(bus, [path], rate=0)
    assert waiting.wait(30)
    player.stop()
    given_up.set()
    assert player.close().events == 0


def test_what_goes_wrong_while_playing_is_raised_at_the_end(bus: Bus, path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And the status says that it failed."""
    night(path)

    def send(_stage: Stage, _event: AnyEvent) -> None:
        raise PublisherClosedError("somebody else closed it")

    monkeypatch.setattr(Stage, "send", send)
    player = Player(bus, [path], rate=0)
    assert player.wait(30)
    assert player.status()["state"] == "failed"
    with pytest.raises(PublisherClosedError):
        player.close()
