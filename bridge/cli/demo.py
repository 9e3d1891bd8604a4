"""`tcbridge demo`: the main job, end to end, with real processes."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

from cyclopts import Group, Parameter

from bridge.cli.exits import Usage
from bridge.cli.options import BASIC, LANG, Basic

DEMO = Group("Demo", sort_key=10)


def demo(
    *,
    keep: Annotated[Path | None, Parameter(help="Folder that keeps recording, live state and classes.", group=DEMO)] = None,
    lang: Annotated[str | None, LANG] = None,
    common: Basic = BASIC,
) -> int:
    """Show the main job, end to end.

    In a realm and scouting group of its own it starts a logger, two publishers,
    two listeners with different filters and a recorder as separate processes.
    Alarms are raised, confirmed and cleared. Then the recording is replayed
    into a fresh logger, and both states are compared: exit code 0 when they
    are equal. It takes about ten seconds and needs no network.

    Try:
        tcbridge demo --lang de
        tcbridge demo --keep demo
        tcbridge replay demo/demo.mcap --against demo/live.json
    """
    from bridge.cli.demo_plant import run

    settings = common.load(lang=lang)
    if keep is None:
        with TemporaryDirectory(prefix="tcbridge-demo-") as folder:
            return run(Path(folder), settings.lang, as_json=common.json)
    for name in ("demo.mcap", "live.json", "plant.tmc"):
        if (keep / name).exists():
            raise Usage(f"--keep {keep}: {name} is there already")
    keep.mkdir(parents=True, exist_ok=True)
    code = run(keep.resolve(), settings.lang, as_json=common.json)
    if not common.json:
        print(f"compare again: tcbridge replay {keep / 'demo.mcap'} --against {keep / 'live.json'} --classes {keep}")
    return code
