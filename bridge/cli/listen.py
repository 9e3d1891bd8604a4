"""`tcbridge listen`: events as they come."""

import time
from typing import Annotated

from cyclopts import Group, Parameter

from bridge.cli.exits import Exit
from bridge.cli.options import COMMON, Common, catalog, note, open_bus, parse_filter
from bridge.cli.show import View, print_json
from bridge.cli.signals import Interrupted

STREAM = Group("Stream", sort_key=10)


def listen(
    *,
    filter: Annotated[str, Parameter(help="Which events, e.g. 'severity >= error'. Default: all.", group=STREAM)] = "",
    with_state: Annotated[bool, Parameter(help="First print the alarms that are active now.", group=STREAM)] = False,
    count: Annotated[int | None, Parameter(help="End after so many events.", group=STREAM)] = None,
    timeout: Annotated[float | None, Parameter(help="End after so many seconds.", group=STREAM)] = None,
    common: Common = COMMON,
) -> int:
    """Print the events that a filter takes, as they come.

    It ends when stopped, after --count events, or when --timeout is over (1 if
    fewer than --count came). What is missing is said in place: gap, dropped,
    rejected, tail unknown. The exit code is then 3.

    Texts are in --lang: from --classes, else from whoever offers the class.

    Try:
        tcbridge listen --filter "severity >= error and source.name like '%X1%'"
        tcbridge listen --target plc1 --count 1 --timeout 10 --json
    """
    from bridge.core.events import Event
    from bridge.core.filters.text import to_text
    from bridge.listener import Listener
    from bridge.notices import Loss
    from bridge.texts import Texts

    settings = common.load()
    known = catalog(settings)
    ends_s = None if timeout is None else time.monotonic() + timeout
    events = notices = 0
    with (
        open_bus(settings) as bus,
        Texts(bus, realm=settings.realm, catalog=known) as texts,
        Listener(
            bus,
            parse_filter(filter, known, texts.guids),
            realm=settings.realm,
            target=settings.target or None,
            with_state=with_state,
        ) as listener,
    ):
        view = View(known, settings.lang, texts)
        try:
            note(f"listening in realm {settings.realm} for {to_text(listener.filter) or 'everything'}")
            if with_state and common.json:
                for alarm in listener.alarms:
                    print_json({"state": view.alarm_record(alarm)})
            elif with_state:
                view.print_alarms(listener.alarms, title="active alarms")
            while count is None or events < count:
                left_s = None if ends_s is None else max(0.0, ends_s - time.monotonic())
                item = listener.get(left_s)
                if item is None:
                    break
                # Counted before it is shown: whoever sees a loss and stops us gets the exit code of a loss.
                if isinstance(item, Event):
                    events += 1
                elif isinstance(item, Loss):
                    notices += 1
                view.print_item(item, as_json=common.json)
        except Interrupted:
            pass
        else:
            if count is not None and events < count:
                note(f"{events} of {count} events came in {timeout} s")
                return Exit.NO
    return Exit.LOST if notices else Exit.OK
