"""What a logger says when it is asked on the bus: its log in parts, what became of a command.

Rule 1: a question that cannot be read, and a filter that is none, are refused with the reason; nothing is left unanswered.
Rule 2: a command is taken only on the key of its own name, so that access can be granted command by command.
Rule 3: an answer has at most PART_ITEMS items in a part, and the last part says that it is the last.
"""

from collections.abc import Callable, Iterator

import msgspec

from bridge.core import keys
from bridge.core.filters.ast import UnknownClassError
from bridge.core.filters.text import FilterSyntaxError
from bridge.core.hresult import AdsError
from bridge.core.questions import PART_ITEMS, CommandAnswer, CommandQuestion, LogPart, LogQuestion, Stored
from bridge.edges.bus import Question, Refusal, Reply


def answer_log(
    question: Question, rows_of: Callable[[LogQuestion], Iterator[Stored]], *, session: str, read_only: bool
) -> Iterator[Reply | Refusal]:
    """The stored events that are asked for."""
    try:
        rows = rows_of(msgspec.json.decode(question.payload or b"{}", type=LogQuestion))
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        yield Refusal(f"no question about the log: {error}")
        return
    except (FilterSyntaxError, UnknownClassError, keys.KeyFormatError, AdsError) as error:
        yield Refusal(str(error))
        return

    def reply(part: int, events: list[Stored], *, last: bool) -> Reply:
        answer = LogPart(session=session, part=part, last=last, events=tuple(events), read_only=read_only)
        return Reply(msgspec.json.encode(answer))

    part, events = 0, list[Stored]()
    for row in rows:
        if len(events) == PART_ITEMS:
            yield reply(part, events, last=False)
            part, events = part + 1, []
        events.append(row)
    yield reply(part, events, last=True)


def answer_command(question: Question, carry_out: Callable[[CommandQuestion], CommandAnswer]) -> Iterator[Reply | Refusal]:
    """What became of a command."""
    try:
        asked = msgspec.json.decode(question.payload, type=CommandQuestion)
        allowed = keys.parse_verb_key(question.key)[3]
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, keys.KeyFormatError) as error:
        yield Refusal(f"no command: {error}")
        return
    name = str(asked.command.__struct_config__.tag)
    if allowed != (name,):
        yield Refusal(f"{name} was asked on the key of {'/'.join(allowed)}")
        return
    yield Reply(msgspec.json.encode(carry_out(asked)))
