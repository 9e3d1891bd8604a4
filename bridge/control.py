"""Programs that can be told something while they run: recorders and players, by their name in a realm.

Rule 1: a name is held once per realm. It has a liveliness token, so that who is there can be listed, and so that a second
program of the name is refused.
Rule 2: every question gets an answer: an HRESULT with the status after it, or a refusal with its reason.
Rule 3: a command is carried out once per id. The last ANSWERS_KEPT answers are known by their id.
Rule 4: each command has a key of its own, as a logger's have, so that access can be granted command by command; asked on
another command's key it is refused.
"""

import contextlib
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import Final, NamedTuple, Self

import msgspec

from bridge.asking import ask_sessions, new_id, this_client
from bridge.core import keys
from bridge.core.control import CONTROLS, ControlAnswer, ControlCommand, ControlQuestion, Facts, Status, control_name
from bridge.core.hresult import ADS_E_INVALIDPARM, ADS_E_SRVNOTSUPP, S_OK, AdsError, raise_if_failed
from bridge.edges.bus import Bus, Question, Refusal, Reply

RECORDER: Final = "recorder"
PLAYER: Final = "player"
ROLES: Final = (RECORDER, PLAYER)
ANSWERS_KEPT: Final = 1000
ASK_S: Final = 5.0
"""How long one question may take: a recorder finishes a file, a player folds a recording up to a place."""
TAKEN_S: Final = 1.0
"""How long the token of a killed program may linger before its name counts as taken."""
_STEP_S: Final = 0.02


class NameTakenError(RuntimeError):
    """There is a program of this name in the realm already."""

    def __init__(self, name: str, realm: str, role: str) -> None:
        self.name, self.realm, self.role = name, realm, role
        super().__init__(f"{name!r} is the name of a {role} in realm {realm} already; choose another")


class NobodyError(RuntimeError):
    """No program of that name answers; realm None is any, `reason` is what was heard instead, "" for nothing."""

    def __init__(self, name: str, realm: str | None, reason: str = "") -> None:
        self.name, self.realm, self.reason = name, realm, reason
        where = "any realm" if realm is None else f"realm {realm}"
        super().__init__(f"no recorder or player {name!r} answers in {where}" + (f": {reason}" if reason else ""))


class Present(NamedTuple):
    """A program that can be told something."""

    realm: str
    name: str
    role: str
    session: str


def present(bus: Bus, *, realm: str | None = None, name: str | None = None, timeout_s: float = 0.5) -> list[Present]:
    """Who is there now: in every realm and of every name, unless one is given."""
    found = []
    for role in ROLES:
        for key in bus.who_is_alive(keys.verb_key(realm, name, "@alive", role, None), timeout_s=timeout_s):
            with contextlib.suppress(keys.KeyFormatError):  # a stranger's
                its_realm, its_name, _, parts = keys.parse_verb_key(key)
                found.append(Present(its_realm, its_name, role, parts[1]))
    return sorted(found)


class Control:
    """Lets others tell this program something. A context manager.

    carry_out(question) does what the command says, on a thread of the bus, and raises AdsError (or ValueError, which is
    ADS_E_INVALIDPARM) when it does not; Status never gets there. status() tells how things are, without waiting.
    """

    def __init__(
        self,
        bus: Bus,
        name: str,
        role: str,
        carry_out: Callable[[ControlQuestion], None],
        status: Callable[[], Facts],
        *,
        takes: Sequence[type[ControlCommand]],
        realm: str = keys.LIVE,
    ) -> None:
        """Take the name and answer. NameTakenError when somebody has it; takes are the commands beside Status."""
        self.name, self.role, self.realm = name, role, realm
        self.session = os.urandom(8).hex()
        self._carry_out, self._status = carry_out, status
        self._takes = ("status", *(label for label, kind in CONTROLS.items() if kind in takes))
        self._answers: dict[str, tuple[ControlQuestion, ControlAnswer]] = {}
        self._answering = threading.Lock()
        _refuse_taken(bus, name, realm)
        self._questions = bus.answer(keys.verb_key(realm, name, "@control", None), self._answer)
        self._alive = bus.alive(keys.verb_key(realm, name, "@alive", role, self.session))

    def _answer(self, question: Question) -> Iterator[Reply | Refusal]:
        try:
            asked = msgspec.json.decode(question.payload, type=ControlQuestion)
            allowed = keys.parse_verb_key(question.key)[3]
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, keys.KeyFormatError) as error:
            yield Refusal(f"no command: {error}")
            return
        label = control_name(asked.command)
        if allowed != (label,):
            yield Refusal(f"{label} was asked on the key of {'/'.join(allowed)}")
            return
        with self._answering:  # held until the answer is out: close() waits for it
            yield Reply(msgspec.json.encode(self._once(asked)))

    def _once(self, asked: ControlQuestion) -> ControlAnswer:
        known = self._answers.get(asked.id)
        if known is not None and known[0] == asked:
            return known[1]
        if known is not None or not asked.id:
            reason = "the id belongs to another command" if known is not None else "a command needs an id"
            return self._made(asked, ADS_E_INVALIDPARM, reason)
        result, detail = S_OK, ""
        try:
            if control_name(asked.command) not in self._takes:
                raise AdsError(ADS_E_SRVNOTSUPP, f"a {self.role} takes no {control_name(asked.command)}")
            if not isinstance(asked.command, Status):
                self._carry_out(asked)
        except AdsError as error:
            result, detail = error.code, error.detail
        except ValueError as error:
            result, detail = ADS_E_INVALIDPARM, str(error)
        answer = self._made(asked, result, detail)
        self._answers[asked.id] = (asked, answer)
        if len(self._answers) > ANSWERS_KEPT:
            del self._answers[next(iter(self._answers))]
        return answer

    def _made(self, asked: ControlQuestion, result: int, detail: str) -> ControlAnswer:
        return ControlAnswer(
            id=asked.id, session=self.session, result=result, detail=detail, status=self._status(), takes=self._takes
        )

    def close(self, timeout_s: float = 1.0) -> None:
        """Give the name up, after the answer that is being given. Not from within carry_out()."""
        waited = self._answering.acquire(timeout=timeout_s)
        try:
            self._alive.close()
            self._questions.close()
        finally:
            if waited:
                self._answering.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()


def _refuse_taken(bus: Bus, name: str, realm: str) -> None:
    """Return when nobody has the name; who shows it and does not answer is given TAKEN_S to be gone."""
    deadline, patient = time.monotonic() + bus.undiscovered_s(), False
    while True:
        holders = present(bus, realm=realm, name=name)
        if holders and (_heard(bus, realm, name, Status(), timeout_s=0.5)[0] or (patient and time.monotonic() >= deadline)):
            raise NameTakenError(name, realm, holders[0].role)
        if holders and not patient:
            deadline, patient = max(deadline, time.monotonic() + TAKEN_S), True
        if not holders and time.monotonic() >= deadline:
            return
        time.sleep(_STEP_S)


def _heard(
    bus: Bus, realm: str, name: str, command: ControlCommand, *, timeout_s: float
) -> tuple[dict[str, list[ControlAnswer]], str]:
    payload = msgspec.json.encode(ControlQuestion(id=new_id(), command=command))
    return ask_sessions(
        bus, keys.verb_key(realm, name, "@control", control_name(command)), payload, ControlAnswer, timeout_s=timeout_s
    )


def tell(
    bus: Bus,
    name: str,
    command: ControlCommand,
    *,
    realm: str = keys.LIVE,
    operator: str = "",
    comment: str = "",
    timeout_s: float = 2.0,
) -> ControlAnswer:
    """Tell the program of that name, asking again with the same id until it answers or timeout_s is over.

    AdsError when the answer is a negative HRESULT; NobodyError when nobody answers: whether it was done is unknown then.
    """
    deadline = time.monotonic() + timeout_s
    label = control_name(command)
    question = ControlQuestion(id=new_id(), command=command, operator=operator, client=this_client(), comment=comment)
    payload, key = msgspec.json.encode(question), keys.verb_key(realm, name, "@control", label)
    while True:
        found, reason = ask_sessions(bus, key, payload, ControlAnswer, timeout_s=ASK_S)
        if len(found) > 1:
            raise NobodyError(name, realm, f"{len(found)} programs have that name")
        for answers in found.values():
            raise_if_failed(answers[0].result, answers[0].detail)
            return answers[0]
        if time.monotonic() >= deadline:
            raise NobodyError(name, realm, reason)
        time.sleep(_STEP_S)
