"""A reader written by others, in another language, reads our files: @mcap/core in node."""

import json
from pathlib import Path
from typing import Any

import pytest

from bridge import EventLogger, Recorder, Severity, Source, open_bus
from bridge.core import codec
from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.questions import LogQuestion
from bridge.edges.bus import ALONE
from bridge.edges.recording import RecordingWriter, Viewer, convert, scan
from bridge.edges.recording.layout import Compression
from bridge.edges.recording.viewer import log_schema
from tests.e2e.node_tools import modules, run_node
from tests.unit.edges.recording_stories import AXIS, START, message, record, write_story

INDEXED = """
const { McapIndexedReader } = require("@mcap/core");
const { FileHandleReadable } = require("@mcap/nodejs");
const fzstd = require("fzstd");
const { open } = require("fs/promises");
(async () => {
  const readable = new FileHandleReadable(await open(process.argv[1], "r"));
  const decompressHandlers = { zstd: (data) => fzstd.decompress(data) };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const channels = {};
  for (const channel of reader.channelsById.values()) {
    const schema = reader.schemasById.get(channel.schemaId);
    channels[channel.topic] = {
      encoding: channel.messageEncoding, schema: schema?.name ?? "", schemaEncoding: schema?.encoding ?? "",
      metadata: Object.fromEntries(channel.metadata), messages: [], times: [],
    };
  }
  for await (const message of reader.readMessages()) {
    const channel = channels[reader.channelsById.get(message.channelId).topic];
    channel.messages.push(channel.encoding == "json" ? JSON.parse(new TextDecoder().decode(message.data)) : null);
    channel.times.push(String(message.logTime));
  }
  const attachments = [], metadata = [];
  for await (const attachment of reader.readAttachments()) attachments.push(attachment.name);
  for await (const record of reader.readMetadata()) metadata.push(record.name);
  console.log(JSON.stringify({ channels, attachments, metadata }));
})();
"""
STREAMED = """
const { McapStreamReader } = require("@mcap/core");
const fzstd = require("fzstd");
const reader = new McapStreamReader({ decompressHandlers: { zstd: (data) => fzstd.decompress(data) }, validateCrcs: true });
reader.append(require("fs").readFileSync(process.argv[1]));
let messages = 0;
for (let record; (record = reader.nextRecord()); ) if (record.type === "Message") messages++;
console.log(JSON.stringify(messages));
"""
SCHEMAS = """
console.log(JSON.stringify(require("@foxglove/schemas/jsonschema")));
"""
JAMS = EventClass(
    AXIS,
    "Axis",
    "Axes",
    {1: EventEntry(1, "Jam", Severity.ERROR, "Axis {0} jams"), 2: EventEntry(2, "Moved", Severity.INFO, "Moved to {0} mm")},
)
CATALOG = Catalog([JAMS])


@pytest.fixture(scope="module")
def node(pytestconfig: pytest.Config) -> Path:
    """Where the packages are."""
    return modules(pytestconfig)


def read(node: Path, path: Path) -> dict[str, Any]:
    """What node finds in a file, through its index."""
    found: dict[str, Any] = run_node(node, INDEXED, path)
    return found


def test_node_counts_what_was_sent(node: Path, tmp_path: Path) -> None:
    """A real recording: as many events as the logger's log holds, a readable line for each, a span for the finished alarm."""
    path = tmp_path / "plant.mcap"
    with open_bus(ALONE) as bus, EventLogger("plant", bus=bus) as logger:
        with Recorder(bus, path, viewer=Viewer(lambda event: CATALOG)) as recorder:
            assert recorder.listener.wait_for_beat(logger.session)
            for number in range(300):
                logger.send_message(AXIS, 2, Severity.INFO, arguments=(number,), source=Source(name="Line1.X"))
            alarm = logger.create_alarm(AXIS, 1, Severity.CRITICAL, with_confirmation=True).alarm
            logger.raise_alarm(alarm, arguments=("X1",))
            logger.clear_alarm(alarm)
            logger.confirm_alarm(alarm, operator="kim")
        log = [stored.event for stored in logger.log(LogQuestion(newest_first=False))]
    channels = read(node, path)["channels"]
    sent = channels[f"/plant/{AXIS}"]["messages"]
    assert sorted(event["seq"] for event in sent) == [event.seq for event in log]
    assert len(sent) == len(log) == 303
    lines = channels["/log"]["messages"]
    assert channels["/log"]["schema"] == "foxglove.Log"
    assert [line["message"] for line in lines if line["name"] == "Line1.X"] == [
        f"Moved to {number} mm" for number in range(300)
    ]
    assert [line["message"] for line in lines if line["level"] == 5] == [
        "raised: Axis X1 jams",
        "cleared: Axis X1 jams",
        "confirmed by kim: Axis X1 jams",
    ]
    times = [line["timestamp"]["sec"] * 1_000_000_000 + line["timestamp"]["nsec"] for line in lines]
    assert sorted(times) == sorted(event.time_ns for event in log)
    (span,) = channels["/alarms"]["messages"]
    assert channels["/alarms"]["schema"] == "foxglove.Event"
    assert {"key": "alarm", "value": "Axis X1 jams"} in span["metadata"]


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_node_lists_the_channels_and_counts_the_same(node: Path, tmp_path: Path, compression: Compression) -> None:
    """Indexed, so summary, chunk and message indexes are right too; and what is converted can all be read as JSON."""
    path = tmp_path / "a.mcap"
    write_story(path, compression=compression)
    found = read(node, path)
    assert {topic: len(channel["messages"]) for topic, channel in found["channels"].items()} == {
        each.topic: each.messages for each in scan(path).channels
    }
    assert sum(channel["encoding"] == "msgpack" for channel in found["channels"].values()) == 2
    convert(path, tmp_path / "b.mcap", Viewer(lambda event: CATALOG, own=CATALOG), compression=compression)
    again = read(node, tmp_path / "b.mcap")
    assert {channel["encoding"] for channel in again["channels"].values()} == {"json"}
    assert sum(len(each["messages"]) for each in again["channels"].values() if each["schema"] == "tcbridge.Event") == 14
    assert len(again["channels"]["/log"]["messages"]) == 16
    assert again["attachments"] == ["event.schema.json"]
    assert again["metadata"] == ["tcbridge", "tcbridge.summary"]


def test_node_reads_a_file_that_was_not_finished(node: Path, tmp_path: Path) -> None:
    """As a stream: everything up to the last flush, as our own reader has it."""
    writer = RecordingWriter(tmp_path / "a.mcap", viewer=Viewer(lambda event: CATALOG, own=CATALOG))
    for number in range(50):
        record(writer, message(number), START + number, codec.JSON)
        if number % 20 == 19:
            writer.flush()
    writer.abandon()
    assert run_node(node, STREAMED, writer.active_path) == 80
    assert scan(writer.active_path).totals.events == 40


def test_our_log_is_foxgloves(node: Path) -> None:
    """The schema names the same fields with the same types and levels as the one that Foxglove publishes."""
    published, ours = run_node(node, SCHEMAS)["Log"], json.loads(log_schema())
    assert (published["title"], published["type"]) == (ours["title"], ours["type"])
    assert published["required"] == ours["required"]
    assert _bare(published["properties"]) == _bare(ours["properties"])


def _bare(properties: dict[str, Any]) -> dict[str, Any]:
    """Names and types: a level is its numbers, all else loses its words and bounds."""
    return {
        name: {each["title"]: each["const"] for each in part["oneOf"]}
        if "oneOf" in part
        else _bare(part["properties"])
        if "properties" in part
        else part["type"]
        for name, part in properties.items()
    }
