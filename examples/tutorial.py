"""Tutorial (manual 9.1.1): define an event class, send its event, see it in the log with its text.

python examples/tutorial.py
"""

from pathlib import Path

from bridge import EventLogger
from bridge.core.times import time_text
from bridge.edges.bus import ALONE
from bridge.edges.class_files import load_catalog

CLASSES = Path(__file__).with_name("samples.classes.toml")


def main() -> None:
    catalog, _ = load_catalog([CLASSES])
    tutorial = catalog.newest("TutorialClass")
    event = tutorial.events[1]
    with EventLogger("plc1", config=ALONE, object_id=0x08502000) as logger:
        logger.send_message(tutorial.guid, event.id, event.severity)
        for language in ("en-US", "de-DE"):
            for stored in logger.log():
                sent = stored.event
                class_name, text = catalog.class_name(sent.event_class, language), catalog.event_text(sent, language)
                print(f"{sent.severity.name.title()} | {class_name} | {sent.event_id} | {text}")
                print(f"    {sent.source_name} 0x{sent.source_id or 0:08X}, {time_text(sent.time_ns, 3)}")


if __name__ == "__main__":
    main()
