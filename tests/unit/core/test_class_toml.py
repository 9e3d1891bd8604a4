"""Classes as TOML: what is read, what is said about faults, and that what is written reads back equal."""

import msgspec
import pytest

from bridge.core.catalog import Catalog, CauseRemedy, Detail, EventClass, EventEntry
from bridge.core.class_toml import read_classes, write_classes
from bridge.core.definitions import content_guid, define_class, edited
from bridge.core.events import Severity
from bridge.core.tmc import Problem, TmcError
from bridge.core.toml_text import MAX_BYTES

PUMP = "11111111-0000-0000-0000-00000000abcd"
OLD = "33333333-0000-0000-0000-000000000003"
SMALL = """\
[[classes]]
name = "Pump"
display_text = "Pumps"
translations = { de = "Pumpen" }

[[classes.events]]
id = 1
name = "Started"
severity = "info"
display_text = "Pump {0} started"
translations = { de-DE = "Pumpe {0} läuft", 1036 = "Pompe {0} démarrée" }

[[classes.events]]
id = 0x10
name = "Stuck"
severity = "Error"
"""


def read(text: str) -> tuple[EventClass, ...]:
    result = read_classes(text.encode(), "plant.toml")
    assert result.problems == ()
    return result.classes


def small() -> EventClass:
    (found,) = read(SMALL)
    return found


# WHAT IS READ -----------------------------------------------------------------------------------------------------------------


def test_a_small_class() -> None:
    """Names, texts, severities in any case, translations beside their texts; the GUID comes by itself."""
    assert small() == define_class(
        "Pump",
        "Pumps",
        [EventEntry(1, "Started", Severity.INFO, "Pump {0} started"), EventEntry(16, "Stuck", Severity.ERROR)],
        translations={"Pumps": {1031: "Pumpen"}, "Pump {0} started": {1031: "Pumpe {0} läuft", 1036: "Pompe {0} démarrée"}},
    )


def test_a_class_with_everything() -> None:
    """A given GUID is taken as it is; causes, details, properties, and texts without a place of their own."""
    text = f"""
[[classes]]
name = "Pump"
namespace = "opt"
guid = "{{{PUMP.upper()}}}"
hides = ["{OLD}"]
hide_needless_arguments = true
comment = "for the pump"
properties = {{ plcAttribute_to_string = "1" }}
attributes = {{ TcBaseType = "true" }}
texts.Dirt = {{ de = "Schmutz" }}

[[classes.events]]
id = 1
name = "Stuck"
severity = "critical"
display_text = '''
two lines
{{0}}'''
comment = "note"
properties = {{ a = "b" }}
details = [{{ name = "Wiring", text = "Sheet 3", comment = "left" }}]

[[classes.events.causes]]
id = 3
cause = "Dirt"
remedy = "Clean"

[[classes.events.causes]]
id = 4
cause = "Wear"
"""
    (found,) = read(text)
    assert found == EventClass(
        guid=PUMP,
        name="Pump",
        namespace="opt",
        events={
            1: EventEntry(
                1,
                "Stuck",
                Severity.CRITICAL,
                "two lines\n{0}",
                "note",
                (CauseRemedy(3, "Dirt", "Clean"), CauseRemedy(4, "Wear")),
                (Detail("Wiring", "Sheet 3", "left"),),
                {"a": "b"},
            )
        },
        translations={"Dirt": {1031: "Schmutz"}},
        hides=(OLD,),
        hide_needless_arguments=True,
        comment="for the pump",
        properties={"plcAttribute_to_string": "1"},
        attributes={"TcBaseType": "true"},
    )


def test_an_edit_of_the_file_is_a_new_version_that_hides_the_published_one() -> None:
    """Write it once, edit a text by hand: the GUID is new and the old one hidden; a translation alone changes neither."""
    first = small()
    published = write_classes([first]).decode()
    assert f'published = "{first.guid}"' in published
    assert read(published) == (first,)
    (second,) = read(published.replace('"Pump {0} started"', '"Pump {0} is running"'))
    assert second.guid != first.guid
    assert second.hides == (first.guid,)
    assert second.guid == edited(first, second).guid == content_guid(second)
    assert Catalog([first, second]).newest("Pump") is second
    (translated,) = read(published.replace("Pumpen", "Pumpwerke"))
    assert (translated.guid, translated.hides) == (first.guid, ())


def test_lines_of_classes_and_events() -> None:
    """For whoever has something to say about them."""
    result = read_classes((SMALL + "\n" + SMALL.replace("Pump", "Valve")).encode())
    pump, valve = result.classes
    assert [result.line(pump.guid), result.line(pump.guid, 1), result.line(pump.guid, 16)] == [1, 6, 13]
    assert [result.line(valve.guid), result.line(valve.guid, 1), result.line(valve.guid, 99)] == [18, 23, 18]


def test_a_header_inside_a_text_is_a_text() -> None:
    """Lines are counted past it."""
    text = SMALL.replace('"Pumps"', "'''\n[[classes]]\n[[classes.events]]\n'''")
    result = read_classes(text.encode())
    (found,) = result.classes
    assert found.display_text == "[[classes]]\n[[classes.events]]\n"
    assert result.line(found.guid, 1) == 9


# WHAT IS SAID -----------------------------------------------------------------------------------------------------------------

FAULTS = [
    ('severity = "info"', 'sevrity = "info"', 9, "unknown key 'sevrity', did you mean 'severity'?"),
    ('name = "Pump"', 'name = "Pump"\ntitel = "x"', 3, "unknown key 'titel'; expected one of name, events, namespace, "),
    ("id = 1", 'causes = [{ id = 1, cause = "a", remdy = "b" }]\nid = 1', 7, "unknown key 'remdy', did you mean 'remedy'?"),
    ('severity = "info"', 'severity = "fatal"', 9, "event Pump.Started: severity 'fatal'; expected one of verbose, info, "),
    ('severity = "info"', "severity = 1", 9, "severity: Expected 'str', got 'int'"),
    ("id = 1", "id = -1", 7, "id: Expected 'int' >= 0"),
    ("id = 1", "id = 4294967296", 7, "id: Expected 'int' <= 4294967295"),
    ("id = 1", "id = 16", 13, "event class Pump: id 16 is used twice, by Started and Stuck; expected different ids"),
    ("id = 1\n", "", 6, "no 'id'"),
    ('name = "Started"', 'name = " Started"', 1, "event 1 of event class Pump is named ' Started'; expected a name without"),
    ('{ de = "Pumpen" }', '{ klingon = "x" }', 4, "unknown language 'klingon'; expected an LCID or a tag"),
    ('{ de = "Pumpen" }', '{ de = "a", de-DE = "b" }', 4, "'Pumps' has two translations into de-DE; expected one"),
    ('name = "Pump"', 'name = "Pump"\nguid = "x"', 1, "'x' is no GUID"),
    ('name = "Pump"', 'name = "Pump"\npublished = "x"', 1, "'x' is no GUID"),
    ('name = "Pump"', f'name = "Pump"\nguid = "{PUMP}"\npublished = "{OLD}"', 4, "event class Pump: both guid and published"),
    ('name = "Pump"', 'name = "Pump"\nhides = ["old"]', 1, "'old' is no GUID"),
    ('name = "Pump"', 'name = "Pump"\nhides = "old"', 3, "hides: Expected 'array', got 'str'"),
]


@pytest.mark.parametrize(("old", "new", "line", "message"), FAULTS)
def test_a_broken_class_is_a_problem_and_the_others_are_read(old: str, new: str, line: int, message: str) -> None:
    """File, line, and what was expected; the whole class behind it is there."""
    assert old in SMALL
    text = SMALL.replace(old, new, 1) + "\n" + SMALL.replace("Pump", "Valve")
    result = read_classes(text.encode(), "plant.toml")
    assert [found.name for found in result.classes] == ["Valve"]
    (problem,) = result.problems
    assert problem == Problem("plant.toml", line, problem.message)
    assert message in problem.message


def test_a_class_without_events_is_a_problem() -> None:
    """No list of events, or an empty one."""
    for text in ('[[classes]]\nname = "Pump"', '[[classes]]\nname = "Pump"\nevents = []'):
        result = read_classes(text.encode())
        assert result.classes == ()
        assert "event" in result.problems[0].message


@pytest.mark.parametrize(
    ("data", "line", "message"),
    [
        (b"", 1, "no list of classes; expected [[classes]]"),
        (b"classes = 1", 1, "no list of classes"),
        (b"classes = [1]", 1, "no list of classes"),
        (b"[classes]\nname = 'x'", 1, "no list of classes"),
        (b"\n[[klasses]]\nname = 'x'", 2, "unknown key 'klasses'; expected [[classes]]"),
        (b"[[classes]]\nname = Pump\n", 2, "Invalid value in column 8; expected a TOML file"),
        (b"[[classes]]\nname = 'Pump", 2, "expected a TOML file"),
        (b"[[classes]]\nname = 'P\xff'\n", 2, "no UTF-8; expected a TOML file"),
        ("x = 'ü'".encode("utf-16"), 1, "no UTF-8"),
        (b"<TcModuleClass/>", 1, "expected a TOML file"),
        (b"x = " + b"[" * 200_000, 1, "nested too deep"),
        (b"x = " + b"1" * 200_000, 1, "expected a TOML file"),
        (b"\n" + b"a." * 200_000 + b"a = 1", 2, "a key of more than 16 parts"),
        (b"x = {" + b'"a" . ' * 100_000 + b"a = 1}", 1, "a key of more than 16 parts"),
        (b"#" * (MAX_BYTES + 1), 1, "1000001 bytes; expected at most 1000000"),
    ],
)
def test_what_is_no_class_file_at_all(data: bytes, line: int, message: str) -> None:
    """An error with file and line, and what a class file looks like."""
    with pytest.raises(TmcError) as caught:
        read_classes(data, "plant.toml")
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"plant.toml:{line}: ")


def test_a_file_cut_anywhere_is_an_error_or_a_beginning() -> None:
    """Every cut gives TmcError, a problem, or fewer classes, events or texts: never another exception."""
    data = (SMALL + "\n" + SMALL.replace("Pump", "Valve")).encode()
    seen: set[int] = set()
    for end in range(len(data)):
        try:
            result = read_classes(data[:end])
        except TmcError:
            continue
        seen.add(len(result.classes))
    assert seen == {0, 1, 2}


# WHAT IS WRITTEN --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "text",
    [
        "",
        "plain",
        " two  blanks ",
        "\"quoted\" 'twice' \\ \\n #",
        "line\nfeed, tab\t, return\r, both\r\n",
        "\x00\x01\x1f\x7f\x80\u2028€𝄞",
        "a.b = c",
        "[[classes]]",
    ],
)
def test_what_is_written_reads_back_equal(text: str) -> None:
    """Every part of a class, with every text wherever a text can be; unlike XML, TOML can hold control characters."""
    entry = EventEntry(
        0, "First", Severity.VERBOSE, text, text, (CauseRemedy(3, text, text),), (Detail(text, text, text),), {text: text}
    )
    classes = (
        EventClass(
            PUMP,
            "Pump",
            text,
            {0: entry, 2**32 - 1: msgspec.structs.replace(entry, id=2**32 - 1, name="Last", severity=Severity.CRITICAL)},
            {text: {1031: text, 7: "neutral", 99999: "no tag", 0: "none"}, "other": {1041: text}, "none": {}},
            (OLD,),
            True,
            "opt.in",
            text,
            {text: text},
        ),
        define_class(
            "Valve", text, [EventEntry(1, "Open", Severity.INFO, f"{text}!")], translations={f"{text}!": {1031: text}}
        ),
    )
    result = read_classes(write_classes(classes))
    assert result.problems == ()
    assert result.classes == classes


def test_what_is_written_is_pleasant_to_read() -> None:
    """Translations beside their text, nothing that is empty or usual."""
    assert write_classes([small()]).decode() == SMALL.replace(
        'display_text = "Pumps"', f'published = "{small().guid}"\ndisplay_text = "Pumps"'
    ).replace("{ de = ", "{ de-DE = ").replace("1036", "fr-FR").replace("0x10", "16").replace("Error", "error")


def test_a_lone_surrogate_is_refused() -> None:
    """It has no UTF-8."""
    with pytest.raises(ValueError, match="surrogates not allowed"):
        write_classes([msgspec.structs.replace(small(), comment="\ud800")])
