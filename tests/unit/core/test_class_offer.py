"""Classes on their way: what is asked, what comes back, and what happens to classes too large for one part."""

import msgspec
import pytest

from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.class_offer import MAX_ASKED, PART_BYTES, ClassesPart, ClassesQuestion, Joined, answer, join
from bridge.core.events import Severity

NEW = "54cc5482-ad79-4cdc-8c3e-b3983b36ed66"
OLD = "695e2e22-3f74-4ec5-a795-e51962a66fcb"
GONE = "64b4d49e-1bd8-462d-9a40-2904237f1837"
AXIS = EventClass(
    NEW,
    "Axis",
    "Axis errors",
    {7: EventEntry(7, "Lag", Severity.ERROR, "Axis {0} lags")},
    {"Axis {0} lags": {1031: "Achse {0} schleppt"}},
    hides=(OLD, GONE),
)
OLDER = EventClass(OLD, "Axis", events={7: EventEntry(7, "Lag", Severity.INFO, "Axis lags")})
CATALOG = Catalog([AXIS, OLDER])


def asked(question: ClassesQuestion, catalog: Catalog = CATALOG) -> Joined:
    """The whole answer, through JSON."""
    parts = [
        msgspec.json.decode(msgspec.json.encode(part), type=ClassesPart)
        for part in answer(catalog, msgspec.json.decode(msgspec.json.encode(question), type=ClassesQuestion), "s1")
    ]
    found = join(reversed(parts))
    assert found is not None
    return found


def test_a_class_comes_back_as_it_is() -> None:
    """By GUID in any spelling: names, texts, translations, severity and what it hides."""
    assert asked(ClassesQuestion(guids=("{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}",))) == Joined({NEW: AXIS}, frozenset())


def test_a_name_means_every_version() -> None:
    """The hidden version keeps its own texts; one that is only known as hidden is no class."""
    assert asked(ClassesQuestion(names=("Axis",))) == Joined({NEW: AXIS, OLD: OLDER}, frozenset())


def test_an_empty_question_means_all() -> None:
    """Every class, and {} is the question."""
    assert asked(msgspec.json.decode(b"{}", type=ClassesQuestion)).classes == {NEW: AXIS, OLD: OLDER}
    assert asked(ClassesQuestion(), Catalog()) == Joined({}, frozenset())


def test_unknown_is_said() -> None:
    """A GUID, a name and nonsense that are not known are listed as they were asked for."""
    found = asked(ClassesQuestion(guids=(GONE, OLD, "nonsense"), names=("Axes",)))
    assert found == Joined({OLD: OLDER}, frozenset({GONE, "nonsense", "Axes"}))


def test_a_large_class_travels_in_pieces() -> None:
    """20,000 events with translations: no part is much larger than PART_BYTES, and joined they are the class again."""
    events = {number: EventEntry(number, f"E{number}", Severity.INFO, f"Text {number} {{0}}") for number in range(20_000)}
    texts = {entry.display_text: {1031: f"Satz {entry.id} {{0}}"} for entry in events.values()}
    large = EventClass(NEW, "Large", "Large class", events, texts, comment="c" * 1000)
    parts = list(answer(Catalog([large, OLDER]), ClassesQuestion(), "s1"))
    assert len(parts) > 5
    assert max(len(msgspec.json.encode(part)) for part in parts) < 1.1 * PART_BYTES
    assert [part.last for part in parts] == [False] * (len(parts) - 1) + [True]
    assert join(parts) == Joined({NEW: large, OLD: OLDER}, frozenset())
    assert join(parts[:-1]) is None
    assert join(parts[1:]) is None
    assert join([]) is None


def test_a_question_is_bounded() -> None:
    """More names than MAX_ASKED are refused."""
    with pytest.raises(ValueError, match="at most 1000"):
        list(answer(CATALOG, ClassesQuestion(names=("x",) * (MAX_ASKED + 1)), "s1"))
