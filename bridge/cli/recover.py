"""`tcbridge recover`: what a crash or a bad disk left of a recording, as a recording again."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from bridge.cli.exits import Exit, Usage
from bridge.cli.options import BASIC, Basic, note
from bridge.cli.progress import counting
from bridge.cli.show import print_json

if TYPE_CHECKING:
    from bridge.edges.recording import Recovered


def recover(
    files: Annotated[
        tuple[Path, ...],
        Parameter(name="FILE", help="Files left behind (.mcap.active), or folders of them.", negative=(), required=True),
    ],
    /,
    *,
    to: Annotated[Path | None, Parameter(help="Write what is readable of a damaged FILE here; FILE stays as it is.")] = None,
    common: Basic = BASIC,
) -> int:
    """Make finished recordings of what was left behind.

    Every whole chunk before the first fault is kept, byte for byte. A file
    name.mcap.active becomes name.mcap; where something was cut off it stays as
    name.mcap.damaged. A file that is being written is refused. record does the
    same by itself at its next start. Exit code 3: something had to be left out.

    Try:
        tcbridge recover plant.mcap.active
        tcbridge recover night/
        tcbridge recover broken.mcap --to whole.mcap
    """
    from bridge.edges.recording import ACTIVE_SUFFIX, leftovers
    from bridge.edges.recording import recover as recover_file

    common.load()
    paths: list[Path] = []
    for file in files:
        if not file.exists():
            raise Usage(f"{file}: no such file")
        paths += leftovers(file) if file.is_dir() else [file]
    if to is not None and (len(paths) != 1 or to.suffix != ".mcap"):
        raise Usage("--to names one file that ends in .mcap, made of one FILE")
    for path in paths:
        if to is None and path.suffix != ACTIVE_SUFFIX:
            raise Usage(f"{path.name} was not left behind by a crash; say with --to where what is readable of it goes")
    lost = False
    for path in paths:
        with counting(f"recovering {path.name}") as show:
            done = recover_file(path, to, on_progress=show)
        lost |= _tell(path, done, as_json=common.json)
    if not paths:
        note("nothing to recover")
    return Exit.LOST if lost else Exit.OK


def _tell(path: Path, done: "Recovered", *, as_json: bool) -> bool:
    lossy = done.damaged_path is not None and done.damage is not None and done.lost_bytes > 0
    if as_json:
        facts = {"recovered": str(done.path), "messages": done.messages, "lost_bytes": done.lost_bytes}
        reason = done.damage.reason if done.damage is not None else ""
        print_json(facts | {"reason": reason, "kept": str(done.damaged_path) if done.damaged_path is not None else None})
    else:
        print(f"recovered {done.messages:,} messages of {path} as {done.path}")
        if done.damage is not None and done.lost_bytes:
            print(f"  {done.lost_bytes:,} bytes behind byte {done.damage.offset:,} were left out: {done.damage.reason}")
        if done.damaged_path is not None and done.damaged_path != path:
            print(f"  the file as it was is {done.damaged_path}")
    return lossy
