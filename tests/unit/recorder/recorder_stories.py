"""Items as a listener hands them to a recorder, and what a window did with them."""

from bridge.core import codec
from bridge.core.events import AlarmCleared, AlarmDisposed, AlarmRaised, AnyEvent, MessageSent, Severity
from bridge.notices import Heard, Item

CLASS = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
OTHER = "0a0b0c0d-0000-4000-8000-000000000001"
S = 1_000_000_000
START = 1_795_000_000 * S


def heard(event: AnyEvent, at_s: float = 0.0) -> Heard:
    """An event as it came, at_s after START."""
    return Heard(event, codec.encode(event), codec.JSON, START + round(at_s * S))


def message(number: int, severity: Severity = Severity.INFO, event_class: str = CLASS) -> MessageSent:
    """A message with a number."""
    return MessageSent(
        target="plc1",
        event_class=event_class,
        event_id=number,
        severity=severity,
        session="publisher",
        seq=number + 1,
        key_seq=number + 1,
        time_ns=START + number,
    )


def raised(number: int, seq: int, *, event_class: str = CLASS, target: str = "plc1") -> AlarmRaised:
    """Alarm `number` is raised; seq is the number of the event in the logger's session."""
    return AlarmRaised(
        target=target,
        event_class=event_class,
        event_id=number,
        severity=Severity.ERROR,
        session="logger",
        seq=seq,
        key_seq=seq,
        time_ns=START + seq,
        raised=True,
        time_raised_ns=START + seq,
    )


def cleared(number: int, seq: int, *, event_class: str = CLASS, target: str = "plc1") -> AlarmCleared:
    """Alarm `number` is cleared."""
    return AlarmCleared(
        target=target,
        event_class=event_class,
        event_id=number,
        severity=Severity.ERROR,
        session="logger",
        seq=seq,
        key_seq=seq,
        time_ns=START + seq,
        time_raised_ns=START,
        time_cleared_ns=START + seq,
    )


def disposed(number: int, seq: int) -> AlarmDisposed:
    """Alarm `number` is gone."""
    return AlarmDisposed(
        target="plc1",
        event_class=CLASS,
        event_id=number,
        severity=Severity.ERROR,
        session="logger",
        seq=seq,
        key_seq=seq,
        time_ns=START + seq,
    )


class Window:
    """What a window got: when it began and why, and its items with their times."""

    def __init__(self, at_ns: int, why: str, passed: int) -> None:
        self.at_ns, self.why, self.passed = at_ns, why, passed
        self.items: list[tuple[Item, int]] = []
        self.ended = False

    @property
    def events(self) -> list[int]:
        """The numbers of its events."""
        return [item.event.event_id for item, _ in self.items if isinstance(item, Heard)]


class Notebook:
    """An Output that remembers. `passed` are the items that left, in or out of windows, in order."""

    def __init__(self) -> None:
        self.windows: list[Window] = []
        self.passed: list[Item] = []

    def begin(self, at_ns: int, why: str) -> None:
        """A window begins; none may be open."""
        assert all(window.ended for window in self.windows)
        self.windows.append(Window(at_ns, why, len(self.passed)))

    def write(self, item: Item, at_ns: int) -> None:
        """An item of the open window."""
        assert not self.windows[-1].ended
        self.windows[-1].items.append((item, at_ns))
        self.passed.append(item)

    def skip(self, item: Item) -> None:
        """An item of no window."""
        self.passed.append(item)

    def end(self) -> None:
        """The window is over."""
        self.windows[-1].ended = True
