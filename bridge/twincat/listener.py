"""An observer as a PLC has it: subscribe, then call Execute() in each cycle (FB_ListenerBase2, manual 6.1.4).

Rule 1: callbacks run inside Execute(), on its caller's thread. One that raises, or answers neither None nor S_OK, pauses
        further ones until the next Execute().
Rule 2: 1,024 events wait at most (manual 4); the oldest leave then, and OnNotice says how many.
Rule 3: subscribing twice is ADS_E_EXISTS, unsubscribing when not subscribed ADS_E_NOTFOUND. Another filter while it runs:
        Unsubscribe and Subscribe2, or listener.replace_filter(), which loses nothing.
"""

from typing import Final

from bridge.core import keys
from bridge.core.events import AlarmCleared, AlarmConfirmed, AlarmDisposed, AlarmRaised, MessageSent
from bridge.core.filters.ast import Expr
from bridge.core.hresult import ADS_E_EXISTS, ADS_E_NOTFOUND, S_OK, AdsError
from bridge.edges.bus import Bus
from bridge.handover import PAUSE
from bridge.listener import Listener, Notice
from bridge.twincat.config import TcEventFilterConfig, selection
from bridge.twincat.filters import EventFilterBase

MAX_QUEUED: Final = 1024
"""Events that wait for Execute(), at most (manual 4)."""


class FB_ListenerBase2:
    """An observer: override the On... methods, subscribe, and call Execute() again and again."""

    def __init__(self, bus: Bus, *, realm: str = keys.LIVE, target: str | None = None) -> None:
        """target: hear only this logger's events, as a PLC hears only its own system's."""
        self._bus, self._realm, self._target = bus, realm, target
        self.listener: Listener | None = None
        """The listener behind it; None when not subscribed."""

    @property
    def bSubscribed(self) -> bool:
        """Whether it is subscribed."""
        return self.listener is not None

    def Subscribe(
        self,
        ipMessageFilterConfig: TcEventFilterConfig | None = None,
        ipAlarmFilterConfig: TcEventFilterConfig | None = None,
    ) -> int:
        """The older form: messages and alarms apart; None takes all of them. S_OK, or AdsError ADS_E_EXISTS."""
        return self._subscribe(selection(ipMessageFilterConfig, ipAlarmFilterConfig))

    def Subscribe2(self, ipEventFilter: EventFilterBase | None = None) -> int:
        """One filter for both; None takes everything. S_OK, or AdsError ADS_E_EXISTS."""
        return self._subscribe(None if ipEventFilter is None else ipEventFilter.expression)

    def _subscribe(self, filter: Expr | None) -> int:
        if self.listener is not None:
            raise AdsError(ADS_E_EXISTS, "already subscribed")
        self.listener = Listener(self._bus, filter, realm=self._realm, target=self._target, queue_events=MAX_QUEUED)
        return S_OK

    def Unsubscribe(self) -> int:
        """Hear no more; what still waited is dropped. S_OK, or AdsError ADS_E_NOTFOUND."""
        if self.listener is None:
            raise AdsError(ADS_E_NOTFOUND, "not subscribed")
        self.listener.close()
        self.listener = None
        return S_OK

    def Execute(self) -> int:
        """Call back for what waits. S_OK, also when nothing waits; an error of a callback comes through."""
        if self.listener is not None:
            self.listener.poll(_Named(self))
        return S_OK

    def OnMessageSent(self, fbEvent: MessageSent) -> int | None:
        """A message was sent."""

    def OnAlarmRaised(self, fbEvent: AlarmRaised) -> int | None:
        """An alarm was raised."""

    def OnAlarmCleared(self, fbEvent: AlarmCleared, bRemove: bool) -> int | None:
        """An alarm was cleared; bRemove: it left the list of active ones."""

    def OnAlarmConfirmed(self, fbEvent: AlarmConfirmed, bRemove: bool) -> int | None:
        """An alarm was confirmed; bRemove: it left the list of active ones."""

    def OnAlarmDisposed(self, fbEvent: AlarmDisposed) -> int | None:
        """An alarm was given up."""

    def OnNotice(self, notice: Notice) -> int | None:
        """Something that a PLC never hears: a loss, a rejected payload, a logger that is gone."""


def _paused(answer: int | None) -> str:
    return "" if answer is None or answer == S_OK else PAUSE


class _Named:
    """The callbacks by the names that a listener calls."""

    def __init__(self, block: FB_ListenerBase2) -> None:
        self._block = block

    def on_message_sent(self, event: MessageSent) -> str:
        return _paused(self._block.OnMessageSent(event))

    def on_alarm_raised(self, event: AlarmRaised) -> str:
        return _paused(self._block.OnAlarmRaised(event))

    def on_alarm_cleared(self, event: AlarmCleared, removed: bool) -> str:
        return _paused(self._block.OnAlarmCleared(event, removed))

    def on_alarm_confirmed(self, event: AlarmConfirmed, removed: bool) -> str:
        return _paused(self._block.OnAlarmConfirmed(event, removed))

    def on_alarm_disposed(self, event: AlarmDisposed) -> str:
        return _paused(self._block.OnAlarmDisposed(event))

    def on_notice(self, notice: Notice) -> str:
        return _paused(self._block.OnNotice(notice))
