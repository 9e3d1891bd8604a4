"""Copy a recording and change one event in it, to see that a comparison finds it.

    tcbridge demo --keep demo
    python examples/change_one_event.py demo/demo.mcap changed.mcap
    tcbridge replay changed.mcap --against demo/live.json

The last command names the difference and ends with 1.
"""

import sys
from pathlib import Path

from msgspec.structs import replace

from bridge.core import codec
from bridge.core.arguments import Argument
from bridge.edges.recording import RecordedEvent, RecordedState, RecordingWriter, read_events


def main(source: Path, target: Path) -> None:
    """Copy events and keyframes; the third event gets another argument."""
    events = 0
    with read_events(source) as reader, RecordingWriter(target) as writer:
        for item in reader:
            if isinstance(item, RecordedState):
                writer.add_state(item.state, item.log_time_ns)
            elif isinstance(item, RecordedEvent):
                events += 1
                event, element = item.event, item.element
                if events == 3:
                    event = replace(event, arguments=(Argument.of("changed"),))
                    element = codec.encode(event, item.encoding)
                    print(f"changed event {event.seq} of session {event.session}")
                writer.add(element, item.encoding, item.key, event, item.log_time_ns)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: change_one_event.py RECORDING CHANGED")
    main(Path(sys.argv[1]), Path(sys.argv[2]))
