"""The older form of a selection: messages and alarms apart, by event class or source, each from a severity upwards.

Rule 1: an event is taken when its class or its source is listed and it is at least as severe as that line says.
Rule 2: no config at all (the 0 pointer of a PLC) takes every message or alarm; a config without a line takes none. The manual
        (6.1.4.7) leaves the second open.
Rule 3: a source is listed by the parts that are given; a part that is absent may be anything.
Rule 4: listing a class or source again replaces its severity; removing what is not listed is ADS_E_NOTFOUND.
"""

from bridge.core.arguments import guid
from bridge.core.events import Severity, Source
from bridge.core.filters.ast import And, Compare, Everything, Expr, Flag, Not, Or
from bridge.core.hresult import ADS_E_INVALIDPARM, ADS_E_NOTFOUND, AdsError


class TcEventFilterConfig:
    """What is listed for messages or for alarms (ITcEventFilterConfig)."""

    def __init__(self) -> None:
        self._classes: dict[str, Severity] = {}
        self._sources: dict[Source, Severity] = {}

    def AddEventClass(self, eventClass: str, eMinSeverity: Severity = Severity.VERBOSE) -> None:
        """Take events of a class (its GUID) from a severity upwards."""
        self._classes[guid(eventClass)] = Severity(eMinSeverity)

    def RemoveEventClass(self, eventClass: str) -> None:
        """Take the class off the list; AdsError ADS_E_NOTFOUND when it is not on it."""
        if self._classes.pop(guid(eventClass), None) is None:
            raise AdsError(ADS_E_NOTFOUND, f"event class {eventClass} is not listed")

    def AddSourceInfo(self, source: Source, eMinSeverity: Severity = Severity.VERBOSE) -> None:
        """Take events of a source from a severity upwards; AdsError ADS_E_INVALIDPARM when it has no part."""
        if source == Source():
            raise AdsError(ADS_E_INVALIDPARM, "a source without id, name and GUID lists nothing")
        self._sources[source] = Severity(eMinSeverity)

    def RemoveSourceInfo(self, source: Source) -> None:
        """Take the source off the list; AdsError ADS_E_NOTFOUND when it is not on it."""
        if self._sources.pop(source, None) is None:
            raise AdsError(ADS_E_NOTFOUND, f"{source} is not listed")

    @property
    def expression(self) -> Expr:
        """The list as a tree."""
        lines = [_all(Compare("event_class", "=", name), _from(severity)) for name, severity in self._classes.items()]
        lines += [_all(*_parts(source), _from(severity)) for source, severity in self._sources.items()]
        return _any(*lines)


def selection(messages: TcEventFilterConfig | None = None, alarms: TcEventFilterConfig | None = None) -> Expr:
    """The filter that the two lists make together."""
    taken_messages = Everything() if messages is None else messages.expression
    taken_alarms = Everything() if alarms is None else alarms.expression
    if taken_messages == taken_alarms == Everything():
        return Everything()
    return _any(_all(Flag("is_message"), taken_messages), _all(Flag("is_alarm"), taken_alarms))


_NOTHING = Not(Everything())


def _from(severity: Severity) -> Expr:
    return Everything() if severity is Severity.VERBOSE else Compare("severity", ">=", severity)


def _parts(source: Source) -> list[Expr]:
    parts = (("source_id", source.id), ("source_name", source.name), ("source_guid", source.guid))
    return [Compare(name, "=", value) for name, value in parts if value is not None]


def _all(*items: Expr) -> Expr:
    if _NOTHING in items:
        return _NOTHING
    left = tuple(item for item in items if item != Everything())
    return And(left) if len(left) > 1 else left[0]


def _any(*items: Expr) -> Expr:
    left = tuple(item for item in items if item != _NOTHING)
    if not left:
        return _NOTHING
    return Or(left) if len(left) > 1 else left[0]
