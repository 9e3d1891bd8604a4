"""`tcbridge send`: one message, from the command line."""

from time import sleep
from typing import Annotated

from cyclopts import Group, Parameter

from bridge.cli import values
from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note, open_bus
from bridge.cli.show import View, print_json, print_spans
from bridge.config import HELP, EncodingName

EVENT = Group("Event", sort_key=10)


def send(
    event_class: Annotated[str, Parameter(name="CLASS", help="Event class: a GUID, or a name.")],
    event_id: Annotated[str, Parameter(name="EVENT", help="Event id, or the event's name in the class.")],
    /,
    *,
    severity: Annotated[
        values.SeverityName | None,
        Parameter(help="Default: that of the class, else info.", group=EVENT),
    ] = None,
    arg: Annotated[
        tuple[str, ...],
        Parameter(
            help="Argument, VALUE or TYPE:VALUE, e.g. 12.5, int16:-3, string:42; repeat it.",
            group=EVENT,
            allow_leading_hyphen=True,
        ),
    ] = (),
    json_attribute: Annotated[str, Parameter(help="JSON attribute, sent as given.", group=EVENT)] = "",
    source_name: Annotated[str | None, Parameter(help="Path of the source.", group=EVENT)] = None,
    source_id: Annotated[int | None, Parameter(help="Object id of the source.", group=EVENT)] = None,
    source_guid: Annotated[str | None, Parameter(help="GUID of the source.", group=EVENT)] = None,
    time: Annotated[str | None, Parameter(help="When it happened, ISO 8601. Default: now.", group=EVENT)] = None,
    wait: Annotated[float, Parameter(help="Seconds to wait for somebody who listens.", group=EVENT, show_default=True)] = 1.0,
    encoding: Annotated[EncodingName | None, Parameter(help=HELP["encoding"], group=EVENT)] = None,
    common: Common = COMMON,
) -> int:
    """Send a message under a target, with or without its logger.

    It is printed as it was sent. If nobody listens it is sent all the same,
    and a hint goes to stderr. Exit code 3: it did not reach the bus.

    Try:
        tcbridge send Line Homed --classes examples/plant.tmc --arg 3 --lang de
        tcbridge send 54cc5482-ad79-4cdc-8c3e-b3983b36ed66 1 --severity error
    """
    settings = common.load(encoding=encoding)
    known = catalog(settings)
    arguments = [values.argument(each) for each in arg]
    source = values.source(source_name, source_id, source_guid)
    time_ns = values.time_ns(time)
    if wait < 0:
        raise Usage(f"--wait {wait} is negative")

    from bridge.publisher import Publisher
    from bridge.texts import Texts

    with open_bus(settings) as bus, Texts(bus, realm=settings.realm, catalog=known) as texts:
        guid, number = values.named_event(event_class, event_id, texts, settings.one_target)
        known = texts.catalog
        chosen = values.severity(severity, guid, number, known)
        publisher = Publisher(bus, settings.one_target, realm=settings.realm, encoding=settings.wire_encoding)
        try:
            heard = publisher.wait_for_listener(wait)
            sleep(bus.undiscovered_s())  # somebody else may still turn up: all who are there shall hear it
            event = publisher.send_message(
                guid, number, chosen, source=source, arguments=arguments, json_attribute=json_attribute, time_ns=time_ns
            )
        finally:
            unsent = publisher.close()
    view = View(known, settings.lang)
    if common.json:
        print_json(view.record(event))
    else:
        print_spans(view.spans(event))
    if unsent:
        note(f"{unsent} event was not sent")
        return Exit.LOST
    if not heard:
        note("nobody is listening")
    return Exit.OK
