"""`tcbridge sink syslog`: events into the log of the system."""

import threading
from typing import Annotated, Final, TypeAlias

from cyclopts import Group, Parameter

from bridge import config
from bridge.cli.exits import Exit, Usage
from bridge.cli.options import COMMON, Common, catalog, note, open_bus, parse_filter
from bridge.cli.show import print_json
from bridge.cli.signals import Interrupted, wait_for_signal

SINK: Final = Group("System log", sort_key=10)
_Types: TypeAlias = Annotated[config.SyslogTypes | None, Parameter(help=config.HELP["syslog_types"], group=SINK)]
_Severity: TypeAlias = Annotated[config.SeverityName | None, Parameter(help=config.HELP["syslog_severity"], group=SINK)]
_Address: TypeAlias = Annotated[str | None, Parameter(help=config.HELP["syslog_address"], group=SINK)]


def syslog(
    *,
    syslog_types: _Types = None,
    syslog_severity: _Severity = None,
    syslog_address: _Address = None,
    facility: Annotated[str, Parameter(help="Facility of the lines.", group=SINK, show_default=True)] = "user",
    filter: Annotated[str, Parameter(help="Which of these events. Default: all.", group=SINK)] = "",
    common: Common = COMMON,
) -> int:
    """Write events into the log of the system (journald, syslog) until stopped.

    One line per event, in --lang. As in TwinCAT it is off by default: say what
    to write with --syslog-types. A log that is not there stops nothing; lines
    that could not be written are counted, and the exit code is then 3. When it
    is stopped it writes what has come, for one second.

    Try:
        tcbridge sink syslog --syslog-types both --syslog-severity warning
        tcbridge sink syslog --syslog-types alarms --syslog-address log-host:514
    """
    from bridge.core.events import Severity
    from bridge.gateways.syslog_sink import SyslogAddressError, SyslogSettings, SyslogSink
    from bridge.texts import Texts

    settings = common.load(syslog_types=syslog_types, syslog_severity=syslog_severity, syslog_address=syslog_address)
    if settings.syslog_types == "none":
        raise Usage("the sink is off: say --syslog-types messages, alarms or both")
    known = catalog(settings)
    chosen = SyslogSettings(
        types=settings.syslog_types,
        min_severity=Severity[settings.syslog_severity.upper()],
        lang=settings.lang,
        filter=parse_filter(filter, known),
        address=settings.syslog_address,
        facility=facility,
    )
    with open_bus(settings) as bus, Texts(bus, realm=settings.realm, catalog=known) as texts:
        try:
            sink = SyslogSink(
                bus,
                chosen,
                realm=settings.realm,
                target=settings.target or None,
                texts=texts,
                resolve_class=known.guids,
                on_trouble=note,
            )
        except SyslogAddressError as error:
            raise Usage(f"--syslog-address: {error}") from None
        except ValueError as error:
            raise Usage(str(error)) from None
        with sink:
            try:
                if common.json:
                    print_json({"ready": "syslog", "address": chosen.address, "types": chosen.types})
                else:
                    print(f"{chosen.types} from {settings.syslog_severity} upwards go to {chosen.address}", flush=True)
                threading.Thread(target=sink.run, name="sink", daemon=True).start()
                wait_for_signal()
            except Interrupted:
                pass
    counters = sink.counters
    if common.json:
        print_json({"stopped": "syslog", "written": counters.written, "failed": counters.failed, "left": counters.left})
    else:
        print(f"{counters.written:,} lines written, {counters.failed + counters.left:,} not", flush=True)
    return Exit.LOST if counters.failed or counters.left else Exit.OK
