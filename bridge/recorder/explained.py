"""What explains a recording to whoever opens it: who recorded what, with what; the metadata of its files."""

import os
import platform
from collections.abc import Sequence
from importlib.metadata import version as version_of
from typing import Final

from bridge.core.filters.ast import Everything
from bridge.core.filters.text import to_text
from bridge.edges.recording import About
from bridge.recorder.capture import Capture
from bridge.recorder.choice import Choice

LIBRARIES: Final = ("eclipse-zenoh", "mcap", "msgspec")


def explained(
    choice: Choice, capture: Capture | None, targets: Sequence[str], *, realm: str, comment: str, version: str
) -> About:
    """The metadata that all files of a new recording share."""
    more = {"versions": _versions()}
    if targets:
        more["targets"] = ", ".join(targets)
    if capture is not None and choice.trigger is not None:
        more |= {"trigger": to_text(choice.trigger), "before_s": f"{capture.before_s:g}", "after_s": f"{capture.after_s:g}"}
    return About(
        version=version,
        host=platform.node(),
        realm=realm,
        filter="" if isinstance(choice.filter, Everything) else to_text(choice.filter),
        comment=comment,
        recording=os.urandom(8).hex(),
        more=more,
    )


def _versions() -> str:
    libraries = (f"{name} {version_of(name)}" for name in LIBRARIES)
    return ", ".join((f"Python {platform.python_version()}", *libraries, platform.platform()))
