"""TwinCAT's class XML: what is read, and what is said about what cannot be read."""

import contextlib
import time
from pathlib import Path

import pytest

from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import Severity
from bridge.core.tmc import MAX_PROBLEMS, Problem, ReadResult, TmcError, read_classes
from bridge.edges.class_files import load_catalog

PUMP = "11111111-0000-0000-0000-00000000abcd"
OLD = "33333333-0000-0000-0000-000000000003"


def event(number: str = "1", name: str = "Start", text: str = "started {0}", severity: str = "Info", more: str = "") -> str:
    return (
        f'<EventId><Name Id="{number}">{name}</Name><DisplayName TxtId=""><![CDATA[{text}]]></DisplayName>'
        f"<Severity>{severity}</Severity>{more}</EventId>"
    )


def data_type(
    *parts: str, name: str = "Pump", guid: str = "{11111111-0000-0000-0000-00000000ABCD}", text: str = "Pumps"
) -> str:
    return f'<DataType><Name GUID="{guid}">{name}</Name><DisplayName TxtId="">{text}</DisplayName>{"".join(parts)}</DataType>'


def document(*types: str, root: str = "TcModuleClass", before: str = "") -> str:
    return f'<?xml version="1.0"?>\n<{root}>{before}<DataTypes>\n' + "\n".join(types) + f"\n</DataTypes></{root}>\n"


def read(*types: str, root: str = "TcModuleClass", before: str = "") -> ReadResult:
    return read_classes(document(*types, root=root, before=before).encode(), "plant.tmc")


def one(*parts: str, before: str = "") -> EventClass:
    result = read(data_type(*parts), before=before)
    assert result.problems == ()
    (found,) = result.classes
    return found


# WHAT IS READ -----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("root", ["TcModuleClass", "TcSmProject", "TcSmItem"])
def test_a_class_with_everything(root: str) -> None:
    """GUID, names, texts, severity, comments, properties and hidden GUIDs, from all three kinds of file."""
    extra = (
        "<Comment>for the pump</Comment>"
        "<Properties><Property><Name>HideNeedlessArguments</Name><Value>1</Value></Property>"
        "<Property><Name>plcAttribute_to_string</Name><Value>1</Value></Property><Property><Name>mark</Name></Property></Properties>"
        f'<Hides><Hide GUID="{{{OLD.upper()}}}"/></Hides>'
    )
    events = event() + event("#x2", "Stop", "stopped", "Critical", "<Comment><![CDATA[at last]]></Comment>")
    result = read(data_type(events, extra).replace("<Name GUID", '<Name PersistentType="true" GUID', 1), root=root)
    assert result.problems == ()
    assert result.classes == (
        EventClass(
            guid=PUMP,
            name="Pump",
            display_text="Pumps",
            events={
                1: EventEntry(1, "Start", Severity.INFO, "started {0}"),
                2: EventEntry(2, "Stop", Severity.CRITICAL, "stopped", "at last"),
            },
            hides=(OLD,),
            hide_needless_arguments=True,
            comment="for the pump",
            properties={"plcAttribute_to_string": "1", "mark": ""},
            attributes={"PersistentType": "true"},
        ),
    )


@pytest.mark.parametrize(
    ("text", "number"), [("0", 0), ("#x2", 2), ("#XfF", 255), ("123456789", 123456789), (" 7 ", 7), ("007", 7)]
)
def test_ids(text: str, number: int) -> None:
    """From 0 to nine digits, decimal or hexadecimal."""
    assert list(one(event(text)).events) == [number]


@pytest.mark.parametrize("text", [PUMP, PUMP.upper(), f"{{{PUMP}}}", f" {{{PUMP.upper()}}} "])
def test_guids(text: str) -> None:
    """With and without braces, in upper and lower case."""
    (found,) = read(data_type(event(), guid=text)).classes
    assert found.guid == PUMP


@pytest.mark.parametrize(
    ("properties", "hidden"),
    [
        ("<Value>1</Value>", True),
        ("<Value>true</Value>", True),
        ("", True),
        ("<Value>0</Value>", False),
        ("<Value>FALSE</Value>", False),
    ],
)
def test_hide_needless_arguments(properties: str, hidden: bool) -> None:
    """The property holds unless its value is 0 or false."""
    extra = f"<Properties><Property><Name>HideNeedlessArguments</Name>{properties}</Property></Properties>"
    assert one(event(), extra).hide_needless_arguments is hidden
    assert one(event(), extra).properties == {}


def test_namespace_and_blanks() -> None:
    """A namespace is read; blanks around a name are not part of it, those in a text are."""
    whole = data_type(event(name="\n Start \n", text=" two  blanks "), name="\n Pump ").replace(
        "<Name GUID", '<Name Namespace="opt" GUID'
    )
    (found,) = read(whole).classes
    assert found.qualified_name == "opt.Pump"
    assert (found.events[1].name, found.events[1].display_text) == ("Start", " two  blanks ")


def test_other_data_types_are_not_classes() -> None:
    """Structs and enums of the same list are passed over without a word."""
    result = read("<DataType><Name>ST_Pump</Name><SubItem><Name>x</Name></SubItem></DataType>", data_type(event()))
    assert [found.name for found in result.classes] == ["Pump"]
    assert result.problems == ()


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_encodings_and_one_line_files(encoding: str) -> None:
    """A BOM, UTF-16 and a declared encoding; all in one line."""
    declared = encoding.removesuffix("-sig")
    text = (
        document(data_type(event(text="Überdruck")))
        .replace('version="1.0"', f'version="1.0" encoding="{declared}"')
        .replace("\n", "")
    )
    (found,) = read_classes(text.encode(encoding), "plant.tmc").classes
    assert found.events[1].display_text == "Überdruck"


def test_a_file_without_classes_is_empty() -> None:
    """No classes is no fault."""
    assert read() == ReadResult(())
    assert read_classes(b"<TcSmProject/>") == ReadResult(())


def translations(**texts: str) -> str:
    return "<Translations>" + "".join(texts.values()) + "</Translations>"


def test_translations_of_file_and_class() -> None:
    """A class gets what its texts have; its own translation comes before that of the file; unused ones stay with the file."""
    file_level = translations(
        a='<Text TxtId="started {0}"><Text LcId="1031">gestartet {0}</Text><Text LcId="1041">J</Text></Text>',
        b='<Text TxtId="Pumps"><Text LcId="1031">Pumpen</Text></Text>',
        c='<Text TxtId="unused"><Text LcId="1031">unbenutzt</Text></Text><Text TxtId="empty"/>',
    )
    own = translations(a='<Text TxtId="started {0}"><Text LcId="#x407">lief an: {0}</Text></Text>')
    result = read(data_type(event(), own), before=file_level)
    (found,) = result.classes
    assert found.translations == {"started {0}": {1031: "lief an: {0}", 1041: "J"}, "Pumps": {1031: "Pumpen"}}
    assert result.translations["started {0}"] == {1031: "gestartet {0}", 1041: "J"}
    assert (result.translations["unused"], result.translations["empty"]) == ({1031: "unbenutzt"}, {})
    catalog = Catalog(result.classes)
    assert catalog.class_name(PUMP, "de") == "Pumpen"


def test_translations_after_the_classes_count_too() -> None:
    """Their place in the file does not matter."""
    text = document(data_type(event())).replace(
        "</TcModuleClass>", translations(a='<Text TxtId="Pumps"><Text LcId="1031">P</Text></Text>')
    )
    (found,) = read_classes(f"{text}</TcModuleClass>".encode()).classes
    assert found.translations == {"Pumps": {1031: "P"}}


# WHAT IS SAID -----------------------------------------------------------------------------------------------------------------

OTHER = data_type(event(), name="Valve", guid=OLD)
FAULTS = [
    (data_type(event(), guid="{12}"), 4, "event class Pump: GUID '{12}'; expected e.g. {54CC"),
    (data_type(event(), guid=""), 4, "event class Pump: no GUID; expected"),
    (data_type(event(), name=""), 4, "the event class has no Name; expected"),
    (data_type(event(number="12x")), 4, "event Pump.Start: Id '12x'; expected 0..4294967295"),
    (data_type(event(number="4294967296")), 4, "event Pump.Start: Id '4294967296'; expected"),
    (data_type(event(number="-1")), 4, "event Pump.Start: Id '-1'; expected"),
    (data_type(event().replace(' Id="1"', "")), 4, "event Pump.Start: no Id; expected"),
    (data_type(event(name="")), 4, "event class Pump: an event has no Name; expected"),
    (
        data_type(event(severity="Fatal")),
        4,
        "event Pump.Start: Severity 'Fatal'; expected one of Verbose, Info, Warning, Error, Critical",
    ),
    (data_type(event(severity="")), 4, "event Pump.Start: no Severity; expected"),
    (
        data_type(event(), "\n", event(name="Go")),
        5,
        "event class Pump: id 1 is used twice, by Start and Go; expected different ids",
    ),
    (data_type(event(), '\n\n<Hides><Hide GUID="x"/></Hides>'), 6, "a Hide of event class Pump: GUID 'x'; expected"),
    (data_type(event(), "<Translations><Text/></Translations>"), 4, "a Text has no TxtId; expected"),
    (
        data_type(event(), '<Translations><Text TxtId="a"><Text LcId="de"/></Text></Translations>'),
        4,
        "the translation of 'a': LcId 'de'; expected",
    ),
]


@pytest.mark.parametrize(("broken", "line", "message"), FAULTS)
def test_a_broken_class_is_a_problem_and_the_others_are_read(broken: str, line: int, message: str) -> None:
    """File, line and what was expected; the broken class is left out, the whole one behind it is there."""
    result = read("<!-- two -->", broken, OTHER)
    assert [found.name for found in result.classes] == ["Valve"]
    (problem,) = result.problems
    assert str(problem).startswith(f"plant.tmc:{line}: {message}")
    assert problem == Problem("plant.tmc", line, problem.message)


def test_every_fault_of_a_class_is_told() -> None:
    """Not only the first one, in the order of lines."""
    result = read(data_type("\n", event(severity="x"), "\n", event(number="y"), '\n<Hides><Hide GUID="z"/></Hides>', guid="g"))
    assert [problem.line for problem in result.problems] == [3, 4, 5, 6]


def test_the_number_of_problems_is_bounded() -> None:
    """A file of nothing but faults does not fill the screen or the memory."""
    result = read(*(data_type(event(severity="x")) for _ in range(3 * MAX_PROBLEMS)))
    assert (len(result.problems), result.classes) == (MAX_PROBLEMS, ())


@pytest.mark.parametrize(
    ("data", "line", "message"),
    [
        (b"", 1, "expected an XML file whose root is TcModuleClass, TcSmProject or TcSmItem"),
        (b"\n\nnot xml", 3, "expected an XML file"),
        (b"<?xml version='1.0'?>\n", 2, "expected an XML file"),
        (b"\x00\x01\x02\xff", 1, "expected an XML file"),
        (b"<?xml version='1.0' encoding='no-such'?><TcModuleClass/>", 1, "expected an XML file"),
        (b"\n<html><body/></html>", 2, "the root is html; expected an XML file"),
        (b"<TcModuleClass xmlns='urn:x'/>", 1, "the root is {urn:x}TcModuleClass; expected"),
        (b" " * 2_000_000, 1, "expected an XML file"),
    ],
)
def test_what_is_no_class_file_at_all(data: bytes, line: int, message: str) -> None:
    """An error with file and line, and what a class file looks like."""
    with pytest.raises(TmcError) as caught:
        read_classes(data, "plant.tmc")
    assert message in str(caught.value)
    assert str(caught.value).startswith(f"plant.tmc:{line}: ")
    assert (caught.value.file, caught.value.line) == ("plant.tmc", line)


BOMB = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))


@pytest.mark.parametrize(
    "doctype",
    [
        f'<!DOCTYPE TcModuleClass [<!ENTITY e0 "ha">{BOMB}]>',
        '<!DOCTYPE TcModuleClass SYSTEM "http://127.0.0.1:9/x.dtd">',
        '<!DOCTYPE TcModuleClass [<!ENTITY e11 SYSTEM "file:///etc/passwd">]>',
        "<!DOCTYPE TcModuleClass>",
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_a_dtd_is_refused(doctype: str, encoding: str) -> None:
    """Billion laughs, external DTDs and external entities end at the DOCTYPE, in any encoding."""
    text = f'<?xml version="1.0" encoding="{encoding}"?>{doctype}<TcModuleClass a="x">&e11;</TcModuleClass>'
    with pytest.raises(TmcError, match="a DTD is refused; expected a file without DOCTYPE"):
        read_classes(text.encode(encoding))


def test_doctype_in_a_text_is_just_a_text() -> None:
    """Only a real one is refused."""
    assert one(event(text="<!DOCTYPE x>")).events[1].display_text == "<!DOCTYPE x>"


def test_a_depth_bomb_is_a_problem() -> None:
    """Elements nest 256 deep at most; the whole classes beside it are read."""
    result = read(OTHER, before="<a>" * 200_000)
    assert "Excessive depth" in result.problems[0].message
    assert [found.name for found in result.classes] == ["Valve"]


# FILES THAT ARE NOT WELL-FORMED -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (data_type(event(severity="a & b")), "a DataType cannot be read"),
        (data_type(event().replace("</EventId>", "")), "a DataType cannot be read"),
        (data_type(event()).replace("</DataType>", ""), "a DataType is not closed; expected </DataType>"),
        (data_type(event(), "&nope;"), "a DataType cannot be read: Entity 'nope' not defined"),
        ("<Translations>" + data_type(event(), name="Third", guid=PUMP.replace("1", "5")), "a Translations is not closed"),
    ],
)
@pytest.mark.parametrize("joint", ["\n", ""])
def test_a_fault_in_one_class_leaves_those_before_and_after(broken: str, message: str, joint: str) -> None:
    """Also in a file of one line: the problems name the fault, the whole classes are there with the file's translations."""
    german = translations(a='<Text TxtId="Pumps"><Text LcId="1031">Pumpen</Text></Text>')
    first = data_type(event(), name="First", guid=PUMP.replace("1", "4"))
    text = document(first, broken, OTHER, before=german).replace("\n", joint)
    result = read_classes(text.encode(), "plant.tmc")
    names = [found.name for found in result.classes]
    assert (names[0], names[-1], "Pump" in names) == ("First", "Valve", False)
    assert all(found.translations == {"Pumps": {1031: "Pumpen"}} for found in result.classes)
    assert any(message in problem.message for problem in result.problems)
    assert "; expected well-formed XML" in "".join(problem.message for problem in result.problems)
    assert {problem.line for problem in result.problems} <= ({1} if joint == "" else {4, 5, 6, 7, 8})


def test_the_line_of_a_fault_in_a_broken_file() -> None:
    """Lines count from the start of the file, also for a class that is read on its own."""
    faulty = data_type("\n", event(severity="x"), name="Faulty", guid=PUMP.replace("1", "6"))
    result = read(OTHER, data_type(event(), "&nope;"), "", faulty)
    assert [(problem.line, problem.message.partition(";")[0]) for problem in result.problems] == [
        (4, "Entity 'nope' not defined"),
        (4, "a DataType cannot be read: Entity 'nope' not defined"),
        (7, "event Faulty.Start: Severity 'x'"),
    ]


def test_bytes_that_are_no_text_break_only_their_class() -> None:
    """A class with a wrong byte is not read with a substitute; the next one is whole."""
    data = document(data_type(event(text="@")), OTHER).encode().replace(b"@", b"\xfc")
    result = read_classes(data, "plant.tmc")
    assert [found.name for found in result.classes] == ["Valve"]
    assert any("no text in the file's encoding" in problem.message for problem in result.problems)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "iso-8859-1", "ascii"])
def test_a_broken_file_in_any_encoding(encoding: str) -> None:
    """The whole classes are read with their letters; one with bytes that are no text is left out, also where it is replaced."""
    far = f"<!--{' ' * 600}-->"  # a wrong byte beside the root is a file that is refused
    text = document(far, data_type(event(text="@")), data_type(event(text="Ü"), name="Valve", guid=OLD), "&nope;")
    declared = encoding.removesuffix("-sig").removesuffix("-le")
    text = text.replace('version="1.0"', f'version="1.0" encoding="{declared}"')
    mark = b"\xff\xfe" if encoding == "utf-16-le" else b""
    letter = text.replace("Ü", "U") if encoding == "ascii" else text
    data = mark + letter.encode(encoding)
    (_, valve) = read_classes(data, "plant.tmc").classes
    assert valve.events[1].display_text == ("U" if encoding == "ascii" else "Ü")
    if encoding != "iso-8859-1":  # where every byte is a text
        wrong = "@".encode(encoding.replace("-sig", "").replace("utf-16", "utf-16-le").replace("-le-le", "-le"))
        result = read_classes(data.replace(wrong, b"\x00\xdc" if len(wrong) == 2 else b"\xff"), "plant.tmc")
        assert [found.name for found in result.classes] == ["Valve"]
        assert any("a DataType cannot be read: bytes that are no text" in problem.message for problem in result.problems)


def test_a_class_in_a_comment_is_none() -> None:
    """Neither in a whole nor in a broken file; a comment mark inside a text is just a text."""
    hidden = f"<!-- {data_type(event(), name='Gone')} -->"
    shown = OTHER.replace("started", "<!-- started </DataType>")
    assert [found.name for found in read(hidden, shown).classes] == ["Valve"]
    assert [found.name for found in read(hidden, shown, "&nope;").classes] == ["Valve"]


def test_a_file_cut_anywhere_is_an_error_or_a_beginning() -> None:
    """Every cut gives TmcError, or the first classes with a problem: never other classes, never another exception."""
    data = document(
        data_type(event()), OTHER, before=translations(a='<Text TxtId="Pumps"><Text LcId="1031">P</Text></Text>')
    ).encode()
    whole = read_classes(data).classes
    assert len(whole) == 2
    seen: set[int] = set()
    for end in range(len(data)):
        try:
            result = read_classes(data[:end])
        except TmcError:
            continue
        seen.add(len(result.classes))
        assert result.classes == whole[: len(result.classes)]
        assert result.problems or not data[end:].strip()
    assert seen == {0, 1, 2}


@pytest.mark.parametrize(
    "data",
    [
        b"<TcModuleClass>" + b"<DataType>" * 300_000,
        b"<TcModuleClass>" + b"<Translations>" * 200_000,
        b"<TcModuleClass>" + b"<!--" * 500_000,
        b"<TcModuleClass>" + b"<DataType " * 300_000,
        b"<TcModuleClass>" + b"<DataType><EventId" * 100_000 + b"</DataType>",
        b"<TcModuleClass a='" + b"x" * 5_000_000,
    ],
    ids=["DataType", "Translations", "comments", "open tags", "EventId", "attribute"],
)
def test_hostile_repetition_costs_linear_time(data: bytes) -> None:
    """Megabytes of beginnings without ends are told within seconds (under 2 s on its own; generous for a busy machine)."""
    began = time.process_time()
    with contextlib.suppress(TmcError):
        assert read_classes(data).classes == ()
    assert time.process_time() - began < 5


# FILES ------------------------------------------------------------------------------------------------------------------------


def test_files_and_folders_become_one_catalog(tmp_path: Path) -> None:
    """Several files and a folder; problems name their file; other files in the folder are passed over."""
    folder = tmp_path / "plant" / "deeper"
    folder.mkdir(parents=True)
    (folder / "a.TMC").write_text(document(data_type(event())), "utf-8")
    (folder / "b.xti").write_text(document(OTHER, root="TcSmItem"), "utf-8")
    (folder / "readme.txt").write_text("nothing", "utf-8")
    bad = tmp_path / "bad.tsproj"
    bad.write_text("nothing", "utf-8")
    catalog, problems = load_catalog([tmp_path / "plant", str(bad)])
    assert catalog.names() == ("Pump", "Valve")
    assert [(problem.file, problem.line) for problem in problems] == [(str(bad), 1)]


def test_a_missing_file_is_the_callers_fault(tmp_path: Path) -> None:
    """A path that was asked for and is not there raises."""
    with pytest.raises(FileNotFoundError):
        load_catalog([tmp_path / "none.tmc"])
