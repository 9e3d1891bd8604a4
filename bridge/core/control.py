"""What a recorder or a player may be told while it runs, and how it answers: the payloads of @control.

Rule 1: a command is a struct; its tag is its name, and it has one field at most. CONTROLS is the table of all of them.
Rule 2: a command carries an id; asking again with the same id gives the same answer and does nothing twice.
Rule 3: every answer has the status of the program after the command: facts by name.
"""

from typing import Annotated, Final, TypeAlias, get_args

import msgspec

from bridge.core.events import U32

Facts: TypeAlias = dict[str, str | int | float | bool]
_MAX_STEP: Final = 1_000_000


class Status(msgspec.Struct, frozen=True, tag_field="do", tag="status"):
    """Tell what it does now; changes nothing."""


class Pause(msgspec.Struct, frozen=True, tag_field="do", tag="pause"):
    """Stand still until told to resume."""


class Resume(msgspec.Struct, frozen=True, tag_field="do", tag="resume"):
    """Go on."""


class Step(msgspec.Struct, frozen=True, tag_field="do", tag="step"):
    """Play so many events, then stand still."""

    events: Annotated[int, msgspec.Meta(ge=1, le=_MAX_STEP)] = 1


class Seek(msgspec.Struct, frozen=True, tag_field="do", tag="seek"):
    """Go to a place in the recording: seconds from its start, or an ISO 8601 time."""

    to: str


class Rate(msgspec.Struct, frozen=True, tag_field="do", tag="rate"):
    """Play at so many times the recorded speed; 0 is as fast as it can."""

    rate: Annotated[float, msgspec.Meta(ge=0)]


class Split(msgspec.Struct, frozen=True, tag_field="do", tag="split"):
    """Finish the file and go on in a new one."""


class Trigger(msgspec.Struct, frozen=True, tag_field="do", tag="trigger"):
    """Write what is in memory and what follows, as if the trigger's filter had matched."""


class Stop(msgspec.Struct, frozen=True, tag_field="do", tag="stop"):
    """Finish and end."""


ControlCommand: TypeAlias = Status | Pause | Resume | Step | Seek | Rate | Split | Trigger | Stop
CONTROLS: Final[dict[str, type[ControlCommand]]] = {str(kind.__struct_config__.tag): kind for kind in get_args(ControlCommand)}
"""Every command by its name."""


def control_name(command: ControlCommand) -> str:
    """The name of a command."""
    return str(command.__struct_config__.tag)


def control_command(name: str, value: str | None = None) -> ControlCommand:
    """A command as a person writes it, with the text of its field. ValueError says what is wrong with which."""
    kind = CONTROLS.get(name)
    if kind is None:
        raise ValueError(f"{name!r} is no command; expected one of {', '.join(CONTROLS)}")
    fields = msgspec.structs.fields(kind)
    if value is not None and not fields:
        raise ValueError(f"{name} takes no value")
    if value is None and fields and fields[0].required:
        raise ValueError(f"{name} needs a value{'' if fields[0].name == name else f': {fields[0].name}'}")
    given = {} if value is None else {fields[0].name: value}
    try:
        command: ControlCommand = msgspec.convert({"do": name, **given}, ControlCommand, strict=False)
    except msgspec.ValidationError as error:
        raise ValueError(f"{name}: {error}") from None
    return command


class ControlQuestion(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A command with its id; who, from where and why go with it as with a command to a logger."""

    id: str
    command: ControlCommand
    operator: str = ""
    client: str = ""
    comment: str = ""


class ControlAnswer(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What became of a command: the HRESULT, a detail for people, the status after it, and who answered.

    takes: the commands that this program takes.
    """

    id: str
    session: str
    result: U32 = 0
    detail: str = ""
    status: Facts = {}
    takes: tuple[str, ...] = ()
