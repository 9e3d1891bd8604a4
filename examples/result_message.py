"""ResultMessage (manual 9.1.2): a component hands its messages to its caller, and sends those from a trace level upwards.

python examples/result_message.py
"""

from pathlib import Path

from bridge import EventLogger, MessageSent, Severity, Source
from bridge.core.catalog import Catalog
from bridge.edges.bus import ALONE
from bridge.edges.class_files import load_catalog

CLASSES = Path(__file__).with_name("samples.classes.toml")
LIBRARY_TRACE_LEVEL = Severity.WARNING
DIVISION_BY_ZERO, OVERFLOW = 1, 2


class MathCalculation:
    """Adds and divides. result_message is the last message, sent or not; trace_level None takes the library's."""

    def __init__(self, logger: EventLogger, catalog: Catalog, trace_level: Severity | None = None) -> None:
        self._logger, self._calculation = logger, catalog.newest("CalculationEventClass")
        self.trace_level = trace_level
        self.result_message: tuple[str, tuple[int, ...]] | None = None
        self.sent: list[MessageSent] = []

    def _tell(self, event_id: int, *arguments: int) -> None:
        event = self._calculation.events[event_id]
        self.result_message = event.name, arguments
        if event.severity >= (LIBRARY_TRACE_LEVEL if self.trace_level is None else self.trace_level):
            source = Source(12, "Math Calculation")
            guid = self._calculation.guid
            self.sent.append(self._logger.send_message(guid, event.id, event.severity, source=source, arguments=arguments))

    def addition(self, left: int, right: int) -> int | None:
        self.result_message = None
        if -(2**31) <= left + right < 2**31:
            return left + right
        self._tell(OVERFLOW, left, right)
        return None

    def division(self, dividend: int, divisor: int) -> float | None:
        self.result_message = None
        if divisor:
            return dividend / divisor
        self._tell(DIVISION_BY_ZERO, dividend)
        return None


class Control:
    """Uses a calculation and treats its message as an error code of its own."""

    def __init__(self, calculation: MathCalculation) -> None:
        self._calculation = calculation

    def execute(self, dividend: int, divisor: int) -> str:
        result = self._calculation.division(dividend, divisor)
        return f"result {result}" if result is not None else f"refused: {self._calculation.result_message}"


def main() -> None:
    catalog, _ = load_catalog([CLASSES])
    with EventLogger("plc1", config=ALONE) as logger:
        loud, quiet = MathCalculation(logger, catalog), MathCalculation(logger, catalog, Severity.CRITICAL)
        for name, calculation in (("library trace level", loud), ("own trace level", quiet)):
            print(f"{name}: {Control(calculation).execute(42, 0)}; {Control(calculation).execute(42, 6)}")
        print(f"addition: {loud.addition(2**31 - 1, 1)}, {loud.result_message}")
        for stored in reversed(list(logger.log())):
            print(f"sent: {catalog.event_text(stored.event)} [{stored.event.source_name} {stored.event.source_id}]")


if __name__ == "__main__":
    main()
