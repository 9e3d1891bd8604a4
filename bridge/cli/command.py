"""`tcbridge create`, `raise`, `clear`, `confirm`, `dispose`: commands to a logger, and its answer.

clear and confirm take one alarm, or --all of them.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, TypeAlias

from cyclopts import Group, Parameter

from bridge.cli import values
from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note, open_bus, operator, parse_filter
from bridge.cli.show import View, clean, print_json, source_text
from bridge.config import HELP, Settings
from bridge.core.alarms import Alarm, AlarmKey
from bridge.core.events import Source

if TYPE_CHECKING:
    from bridge.core.catalog import Catalog
    from bridge.core.filters.ast import Expr
    from bridge.logger import LoggerProxy
    from bridge.texts import Texts

ALARM: Final = Group("Alarm", sort_key=10)
COMMAND: Final = Group("Command", sort_key=11)

EventClass: TypeAlias = Annotated[str, Parameter(name="CLASS", help="Event class: a GUID, or a name.")]
Every: TypeAlias = Annotated[bool, Parameter(name="--all", help="All alarms, or all of --filter.", group=ALARM)]
OfFilter: TypeAlias = Annotated[str, Parameter(name="--filter", help="With --all: which, by their state now.", group=ALARM)]
EventId: TypeAlias = Annotated[str, Parameter(name="EVENT", help="Event id, or the event's name in the class.")]


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Which:
    """Which alarm, beside class and id."""

    source_name: Annotated[str | None, Parameter(help="Path of the source.", group=ALARM)] = None
    source_id: Annotated[int | None, Parameter(help="Object id of the source.", group=ALARM)] = None
    source_guid: Annotated[str | None, Parameter(help="GUID of the source.", group=ALARM)] = None

    @property
    def source(self) -> Source:
        """The source as given."""
        return values.source(self.source_name, self.source_id, self.source_guid)


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class How:
    """Who, when and why."""

    time: Annotated[str | None, Parameter(help="When it happened, ISO 8601. Default: now.", group=COMMAND)] = None
    operator: Annotated[str | None, Parameter(help=HELP["operator"], group=COMMAND)] = None
    comment: Annotated[str, Parameter(help="Why; it stands in the event.", group=COMMAND)] = ""
    wait: Annotated[float, Parameter(help="Seconds to wait for the logger.", group=COMMAND, show_default=True)] = 3.0


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class What:
    """What the alarm says from this transition on."""

    arg: Annotated[
        tuple[str, ...],
        Parameter(help="Argument, VALUE or TYPE:VALUE; repeat it.", group=ALARM, allow_leading_hyphen=True),
    ] = ()
    json_attribute: Annotated[str | None, Parameter(help="JSON attribute, sent as given.", group=ALARM)] = None


WHICH, HOW, WHAT = Which(), How(), What()
Severity: TypeAlias = Annotated[
    values.SeverityName | None, Parameter(help="For a new alarm. Default: that of the class, else info.", group=ALARM)
]
WithConfirmation: TypeAlias = Annotated[bool, Parameter(help="A new alarm has to be confirmed.", group=ALARM)]


@contextmanager
def connected(settings: Settings, wait_s: float) -> "Iterator[LoggerProxy]":
    """The logger of the target. NoLoggerError when it is not there in time."""
    from bridge.logger import LoggerProxy, NoLoggerError

    if wait_s < 0:
        raise Usage(f"--wait {wait_s} is negative")
    with open_bus(settings) as bus:
        proxy = LoggerProxy(bus, settings.one_target, realm=settings.realm)
        if not proxy.connect(wait_s):
            raise NoLoggerError(settings.one_target, f"in realm {settings.realm}")
        with proxy:
            yield proxy


@contextmanager
def _connected_with_texts(settings: Settings, wait_s: float, known: "Catalog") -> "Iterator[tuple[LoggerProxy, Texts]]":
    """The logger of the target, and who asks for classes of no file."""
    from bridge.texts import Texts

    with connected(settings, wait_s) as proxy, Texts(proxy.bus, realm=settings.realm, catalog=known) as texts:
        yield proxy, texts


class _Call:
    """One command: its settings, class and event."""

    def __init__(self, event_class: str, event_id: str, which: Which, how: How, common: Common) -> None:
        self.settings = common.load(operator=how.operator)
        self.catalog = catalog(self.settings)
        self.guid, self.id = "", 0
        self._named = event_class, event_id
        self.source = which.source
        self.time_ns = values.time_ns(how.time)
        self.operator = operator(self.settings)
        self.comment = how.comment
        self.as_json = common.json
        self.wait_s = how.wait

    @contextmanager
    def connected(self) -> "Iterator[LoggerProxy]":
        """The logger of the target; after this guid and id are known, and the catalog has the class if anybody offers it."""
        with _connected_with_texts(self.settings, self.wait_s, self.catalog) as (proxy, texts):
            self.guid, self.id = values.named_event(*self._named, texts, self.settings.one_target)
            self.catalog = texts.catalog
            yield proxy

    @property
    def key(self) -> AlarmKey:
        """The alarm as it was named."""
        source = self.source
        return AlarmKey(self.settings.one_target, self.guid, self.id, source.id, source.name, source.guid)

    def find(self, proxy: "LoggerProxy") -> AlarmKey:
        """The alarm that is meant: without a source, the one active alarm of that class and id."""
        if self.source != Source():
            return self.key
        found = [each for each in proxy.active_alarms() if (each.event_class, each.event_id) == (self.guid, self.id)]
        if len(found) > 1:
            sources = ", ".join(sorted(source_text(each) or "(none)" for each in found))
            raise Usage(f"{len(found)} such alarms are active, name a source: {clean(sources)}")
        return found[0].key if found else self.key

    def show(self, alarm: Alarm) -> int:
        """Print the alarm as it is now."""
        view = View(self.catalog, self.settings.lang)
        if self.as_json:
            print_json(view.alarm_record(alarm))
        else:
            view.print_alarms([alarm])
        return Exit.OK


class _AllCall:
    """One command to all alarms, or to those of a filter."""

    def __init__(self, named: object, filter: str, which: Which, how: How, common: Common) -> None:
        if named or which != WHICH:
            raise Usage("--all stands for every alarm; choose some with --filter")
        self.settings = common.load(operator=how.operator)
        self.catalog = catalog(self.settings)
        self._filter = filter
        self.time_ns = values.time_ns(how.time)
        self.operator = operator(self.settings)
        self.comment = how.comment
        self.as_json = common.json
        self.wait_s = how.wait

    @contextmanager
    def connected(self) -> "Iterator[tuple[LoggerProxy, Expr]]":
        """The logger of the target, and the filter; its classes may be those that the bus knows."""
        with _connected_with_texts(self.settings, self.wait_s, self.catalog) as (proxy, texts):
            expr = parse_filter(self._filter, self.catalog, texts.guids)
            self.catalog = texts.catalog
            yield proxy, expr

    def show(self, alarms: Sequence[Alarm], done: str) -> int:
        """Print the alarms as they are now."""
        view = View(self.catalog, self.settings.lang)
        note(f"{len(alarms)} {'alarm' if len(alarms) == 1 else 'alarms'} {done}")
        if self.as_json:
            for alarm in alarms:
                print_json(view.alarm_record(alarm))
        elif alarms:
            view.print_alarms(alarms)
        return Exit.OK


def _one(event_class: str | None, event_id: str | None, filter: str) -> tuple[str, str]:
    """The class and event of a command to one alarm."""
    if filter:
        raise Usage("--filter needs --all")
    if event_class is None or event_id is None:
        raise Usage("name CLASS and EVENT, or --all")
    return event_class, event_id


def create(
    event_class: EventClass,
    event_id: EventId,
    /,
    *,
    severity: Severity = None,
    with_confirmation: WithConfirmation = False,
    which: Which = WHICH,
    what: What = WHAT,
    wait: Annotated[float, Parameter(help="Seconds to wait for the logger.", group=COMMAND, show_default=True)] = 3.0,
    common: Common = COMMON,
) -> int:
    """Create an alarm without raising it.

    Nobody is told before it is raised. An alarm that exists is left as it is
    and printed; that is no error.

    Try:
        tcbridge create Faults LagError --classes examples/plant.tmc
    """
    call = _Call(event_class, event_id, which, How(wait=wait), common)
    with call.connected() as proxy:
        answer = proxy.create_alarm(
            call.guid,
            call.id,
            values.severity(severity, call.guid, call.id, call.catalog),
            with_confirmation=with_confirmation,
            source=call.source,
            arguments=[values.argument(each) for each in what.arg],
            json_attribute=what.json_attribute or "",
        )
    if not answer.created:
        note("the alarm exists already")
    return call.show(answer.alarm) if answer.alarm is not None else Exit.OK


def raise_(
    event_class: EventClass,
    event_id: EventId,
    /,
    *,
    severity: Severity = None,
    with_confirmation: WithConfirmation = False,
    which: Which = WHICH,
    what: What = WHAT,
    how: How = HOW,
    common: Common = COMMON,
) -> int:
    """Raise an alarm, creating it if need be.

    The alarm is printed as it is then. Exit code 1: the logger refused, with
    the manual's HRESULT. 4: nobody answered, so the outcome is unknown.

    Try:
        tcbridge raise Faults LagError --classes examples/plant.tmc \\
            --source-name Main.Axis3 --arg 3 --arg 12.5 --with-confirmation
    """
    call = _Call(event_class, event_id, which, how, common)
    arguments = [values.argument(each) for each in what.arg]
    with call.connected() as proxy:
        answer = proxy.create_alarm(
            call.guid,
            call.id,
            values.severity(severity, call.guid, call.id, call.catalog),
            with_confirmation=with_confirmation,
            source=call.source,
        )
        return call.show(
            proxy.raise_alarm(
                call.key if answer.alarm is None else answer.alarm,
                time_ns=call.time_ns,
                arguments=arguments or None,
                json_attribute=what.json_attribute,
                operator=call.operator,
                comment=call.comment,
            )
        )


def clear(
    event_class: EventClass | None = None,
    event_id: EventId | None = None,
    /,
    *,
    all: Every = False,
    filter: OfFilter = "",
    reset_confirmation: Annotated[bool, Parameter(help="Nobody has to confirm it any more.", group=ALARM)] = False,
    which: Which = WHICH,
    what: What = WHAT,
    how: How = HOW,
    common: Common = COMMON,
) -> int:
    """Clear an alarm, or --all that are raised.

    Without a source the one active alarm of that class and id is meant. The
    exit codes are those of raise.

    Try:
        tcbridge clear Faults LagError --classes examples/plant.tmc
        tcbridge clear --all --filter "source.name like 'Main.Axis%'"
    """
    if all:
        every = _AllCall(event_class or what != WHAT, filter, which, how, common)
        with every.connected() as (proxy, expr):
            cleared = proxy.clear_alarms(
                expr,
                reset_confirmation=reset_confirmation,
                time_ns=every.time_ns,
                operator=every.operator,
                comment=every.comment,
            )
        return every.show(cleared, "cleared")
    call = _Call(*_one(event_class, event_id, filter), which, how, common)
    with call.connected() as proxy:
        return call.show(
            proxy.clear_alarm(
                call.find(proxy),
                reset_confirmation=reset_confirmation,
                time_ns=call.time_ns,
                arguments=[values.argument(each) for each in what.arg] or None,
                json_attribute=what.json_attribute,
                operator=call.operator,
                comment=call.comment,
            )
        )


def confirm(
    event_class: EventClass | None = None,
    event_id: EventId | None = None,
    /,
    *,
    all: Every = False,
    filter: OfFilter = "",
    which: Which = WHICH,
    how: How = HOW,
    common: Common = COMMON,
) -> int:
    """Confirm an alarm, raised or not, or --all that wait for it.

    Without a source the one active alarm of that class and id is meant. The
    exit codes are those of raise.

    Try:
        tcbridge confirm Faults LagError --classes examples/plant.tmc \\
            --operator "shift leader" --comment "seen, belt replaced"
        tcbridge confirm --all --comment "seen in the control room"
    """
    if all:
        every = _AllCall(event_class, filter, which, how, common)
        with every.connected() as (proxy, expr):
            confirmed = proxy.confirm_alarms(expr, time_ns=every.time_ns, operator=every.operator, comment=every.comment)
        return every.show(confirmed, "confirmed")
    call = _Call(*_one(event_class, event_id, filter), which, how, common)
    with call.connected() as proxy:
        return call.show(
            proxy.confirm_alarm(call.find(proxy), time_ns=call.time_ns, operator=call.operator, comment=call.comment)
        )


def dispose(
    event_class: EventClass,
    event_id: EventId,
    /,
    *,
    which: Which = WHICH,
    how: How = HOW,
    common: Common = COMMON,
) -> int:
    """Let go of an alarm.

    A raised one gets its clear time, and needs no confirmation any more. The
    exit codes are those of raise.

    Try:
        tcbridge dispose Faults LagError --classes examples/plant.tmc
    """
    call = _Call(event_class, event_id, which, how, common)
    with call.connected() as proxy:
        key = call.find(proxy)
        answer = proxy.dispose_alarm(key, time_ns=call.time_ns, operator=call.operator, comment=call.comment)
    if call.as_json:
        print_json({"disposed": key, "seq": answer.seq})
    else:
        print(f"disposed of {clean(call.catalog.class_name(key.event_class, call.settings.lang))} {key.event_id}")
    return Exit.OK
