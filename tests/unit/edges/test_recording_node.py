"""A reader written by others, in another language, reads our files: @mcap/core in node."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from bridge.edges.recording.layout import Compression
from tests.unit.edges.recording_stories import write_story

SCRIPT = """
const { McapIndexedReader } = require("@mcap/core");
const { FileHandleReadable } = require("@mcap/nodejs");
const fzstd = require("fzstd");
const { open } = require("fs/promises");
(async () => {
  const readable = new FileHandleReadable(await open(process.argv[1], "r"));
  const decompressHandlers = { zstd: (data) => fzstd.decompress(data) };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const counts = {};
  for await (const message of reader.readMessages()) {
    const { topic } = reader.channelsById.get(message.channelId);
    counts[topic] = (counts[topic] ?? 0) + 1;
  }
  console.log(JSON.stringify(counts));
})();
"""


def node() -> list[str]:
    """How to run node; skips the test where it or its packages are not installed (NODE_PATH says where they are)."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("node is not installed")
    probe = "for (const name of ['@mcap/core', '@mcap/nodejs', 'fzstd']) require.resolve(name)"
    if subprocess.run([program, "-e", probe], check=False, capture_output=True, timeout=60).returncode:
        pytest.skip("node has no @mcap/core, @mcap/nodejs and fzstd in NODE_PATH")
    return [program, "-e", SCRIPT]


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_node_lists_the_channels_and_counts_the_same(tmp_path: Path, compression: Compression) -> None:
    """Indexed, so summary, chunk and message indexes are right too."""
    command = node()
    path = tmp_path / "a.mcap"
    write_story(path, compression=compression)
    done = subprocess.run([*command, str(path)], check=True, capture_output=True, text=True, timeout=60)
    counts = json.loads(done.stdout)
    assert sum(counts.values()) == 17
    assert {topic for topic in counts if topic.count("/") == 1} == {"/gaps", "/rejected", "/state"}
