"""What a recording holds, counted while it is written or read.

Rule 1: writer and reader count with the same Tally, so that a summary from the file equals one from a scan.
Rule 2: the counts travel as metadata texts with a CRC of their own: MCAP protects metadata only by the CRC of the whole
file, and a summary is read without reading the whole file.
Rule 3: complete says "yes" only when nothing is known to be missing and every tail is known.
Rule 4: active at the start is what keyframes before the first event say, active at the end what all of the file folds to.
"""

import zlib
from typing import Final

import msgspec

from bridge.core.alarms import Alarm
from bridge.core.events import AnyEvent, Count, MessageSent
from bridge.edges.recording.layout import Completeness, EventChannel, Gap, StateFrame
from bridge.edges.recording.standing import Standing

GAPS_NAMED: Final = 100
"""How many gaps a summary names; the rest is only counted."""
ALARMS_NAMED: Final = 100
"""How many active alarms a summary names, the latest; the rest is only counted."""


class EventCount(msgspec.Struct, frozen=True, order=True):
    """How many events of one kind, class and severity."""

    realm: str
    target: str
    event_class: str
    kind: str
    severity: Count
    count: Count


class Active(msgspec.Struct, frozen=True):
    """Alarms that were raised or waited for confirmation; `named` are the latest of them."""

    count: Count = 0
    named: tuple[Alarm, ...] = ()


class Totals(msgspec.Struct, frozen=True, kw_only=True):
    """The counts of a recording. Times are Unix ns, 0 when there is nothing to time; first_time_ns skips events without a time.

    gaps counts records, gap_events the events they miss; named_gaps are the first of them.
    unknown_tails names the sessions whose end is not known ("*": every session, because the recorder was killed).
    next_file is where the recording goes on; "" in its last file and in one that was not finished.
    """

    events: Count = 0
    counts: tuple[EventCount, ...] = ()
    gaps: Count = 0
    gap_events: Count = 0
    named_gaps: tuple[Gap, ...] = ()
    rejected: Count = 0
    states: Count = 0
    active_at_start: Active = Active()
    active_at_end: Active = Active()
    unknown_tails: tuple[str, ...] = ()
    first_log_time_ns: Count = 0
    last_log_time_ns: Count = 0
    first_time_ns: Count = 0
    last_time_ns: Count = 0
    next_file: str = ""

    @property
    def complete(self) -> Completeness:
        """Whether everything that was selected is in the file, as far as the recorder could know."""
        if self.gaps:
            return "no"
        return "tail unknown" if self.unknown_tails else "yes"

    def metadata(self) -> dict[str, str]:
        """As MCAP metadata: numbers and JSON as text."""
        texts = {name: msgspec.json.encode(getattr(self, name)).decode() for name in self.__struct_fields__}
        texts["complete"] = self.complete
        return texts | {"crc32": str(_crc(texts))}

    @classmethod
    def of(cls, metadata: dict[str, str]) -> "Totals | None":
        """Back from MCAP metadata; None when it is damaged or not ours."""
        texts = {name: value for name, value in metadata.items() if name != "crc32"}
        if metadata.get("crc32") != str(_crc(texts)):
            return None
        try:
            values = {name: msgspec.Raw(texts[name].encode()) for name in cls.__struct_fields__}
            return msgspec.json.decode(msgspec.json.encode(values), type=cls)
        except (KeyError, msgspec.MsgspecError):
            return None


def _crc(texts: dict[str, str]) -> int:
    return zlib.crc32(msgspec.json.encode(sorted(texts.items())))


class ChannelTally:
    """The counts of one event channel."""

    __slots__ = ("_standing", "channel", "counts")

    def __init__(self, channel: EventChannel, standing: Standing) -> None:
        self.channel, self._standing = channel, standing
        self.counts: dict[tuple[str, int], int] = {}

    def add(self, event: AnyEvent) -> None:
        """Count one event."""
        if not isinstance(event, MessageSent):
            self._standing.event(self.channel.realm, event)
        place = (event.kind, event.severity)
        self.counts[place] = self.counts.get(place, 0) + 1


class Tally:
    """Counts while events go by."""

    def __init__(self) -> None:
        self._channels: dict[EventChannel, ChannelTally] = {}
        self._named: list[Gap] = []
        self._first_log = self._last_log = self._first = self._last = 0
        self._messages = 0
        self._standing = Standing()
        self._at_start = Active()
        self.gaps = self.gap_events = self.rejected = self.states = 0

    def channel(self, channel: EventChannel) -> ChannelTally:
        """The counter of a channel."""
        found = self._channels.get(channel)
        if found is None:
            found = self._channels[channel] = ChannelTally(channel, self._standing)
        return found

    @property
    def events(self) -> int:
        """How many events so far."""
        return sum(count for channel in self._channels.values() for count in channel.counts.values())

    def time(self, log_time_ns: int) -> None:
        """Take note of when something was logged."""
        if not self._messages or log_time_ns < self._first_log:
            self._first_log = log_time_ns
        if log_time_ns > self._last_log:
            self._last_log = log_time_ns
        self._messages += 1

    def event_time(self, time_ns: int) -> None:
        """Take note of an event's own time."""
        if time_ns:
            if time_ns > self._last:
                self._last = time_ns
            if not self._first or time_ns < self._first:
                self._first = time_ns

    def gap(self, gap: Gap) -> None:
        """Count a gap."""
        self.gaps += 1
        self.gap_events += gap.count
        if len(self._named) < GAPS_NAMED:
            self._named.append(gap)

    def state(self, state: StateFrame) -> None:
        """Count a keyframe."""
        self.states += 1
        self._standing.state(state)
        if not self.events:
            self._at_start = self._active()

    def _active(self) -> Active:
        alarms = self._standing.active()
        return Active(len(alarms), tuple(alarms[-ALARMS_NAMED:]))

    def totals(self, unknown_tails: tuple[str, ...] = (), next_file: str = "") -> Totals:
        """The counts so far."""
        rows: dict[tuple[str, str, str, str, int], int] = {}
        for tally in self._channels.values():
            for (kind, severity), count in tally.counts.items():
                row = (tally.channel.realm, tally.channel.target, tally.channel.event_class, kind, int(severity))
                rows[row] = rows.get(row, 0) + count
        return Totals(
            events=self.events,
            counts=tuple(sorted(EventCount(*row, count) for row, count in rows.items())),
            gaps=self.gaps,
            gap_events=self.gap_events,
            named_gaps=tuple(self._named),
            rejected=self.rejected,
            states=self.states,
            active_at_start=self._at_start,
            active_at_end=self._active(),
            unknown_tails=unknown_tails,
            first_log_time_ns=self._first_log,
            last_log_time_ns=self._last_log,
            first_time_ns=self._first,
            last_time_ns=self._last,
            next_file=next_file,
        )


def joined(first: Totals, second: Totals) -> Totals:
    """The counts of two files of one recording together; next_file is that of the second."""
    counts: dict[tuple[str, str, str, str, int], int] = {}
    for row in (*first.counts, *second.counts):
        place = (row.realm, row.target, row.event_class, row.kind, row.severity)
        counts[place] = counts.get(place, 0) + row.count
    return Totals(
        events=first.events + second.events,
        counts=tuple(sorted(EventCount(*place, count) for place, count in counts.items())),
        gaps=first.gaps + second.gaps,
        gap_events=first.gap_events + second.gap_events,
        named_gaps=(*first.named_gaps, *second.named_gaps)[:GAPS_NAMED],
        rejected=first.rejected + second.rejected,
        states=first.states + second.states,
        active_at_start=first.active_at_start if first.first_log_time_ns else second.active_at_start,
        active_at_end=second.active_at_end,
        unknown_tails=tuple(dict.fromkeys((*first.unknown_tails, *second.unknown_tails))),
        first_log_time_ns=_earliest(first.first_log_time_ns, second.first_log_time_ns),
        last_log_time_ns=max(first.last_log_time_ns, second.last_log_time_ns),
        first_time_ns=_earliest(first.first_time_ns, second.first_time_ns),
        last_time_ns=max(first.last_time_ns, second.last_time_ns),
        next_file=second.next_file,
    )


def _earliest(first_ns: int, second_ns: int) -> int:
    return min(first_ns, second_ns) if first_ns and second_ns else first_ns or second_ns
