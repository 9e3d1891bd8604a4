"""Laws of event texts and class files: whatever comes in, a text or a defined error comes out."""

from hypothesis import given
from hypothesis import strategies as st

from bridge.core.arguments import Argument
from bridge.core.catalog import Catalog, EventClass, EventEntry
from bridge.core.events import Severity
from bridge.core.tmc import Problem, ReadResult, TmcError, read_classes

PUMP = "11111111-0000-0000-0000-000000000001"
OTHER = "22222222-0000-0000-0000-000000000002"
values = st.one_of(
    st.text(max_size=8),
    st.integers(-(2**70), 2**70).map(str),
    st.floats().map(repr),
    st.sampled_from([f"{PUMP}#1", "#1", "#99999999999", f"{OTHER}#1", "AAAA", "1e999", "-nan", "true", "1_0", "٣"]),
)
arguments = st.lists(st.builds(Argument, st.integers(-1, 30), values), max_size=5).map(tuple)
pieces = st.one_of(
    st.text(max_size=5),
    st.integers(0, 6).map(lambda n: f"{{{n}}}"),
    st.builds("{{{},{}}}".format, st.integers(0, 6), st.sampled_from([*"dDeExXfFq", "", " x ", "08x"])),
    st.sampled_from(["{eventID}", "{eventclass}", "{", "}", "{{", "{eventid,X}"]),
)
texts = st.lists(pieces, max_size=8).map("".join)
languages = st.one_of(st.integers(), st.sampled_from([1031, 1033]), st.sampled_from(["de", "en-US"]), st.text(max_size=6))


@given(text=texts, german=texts, given_arguments=arguments, language=languages, hide=st.booleans(), event_id=st.integers(0, 3))
def test_a_text_is_always_a_text(
    text: str, german: str, given_arguments: tuple[Argument, ...], language: int | str, hide: bool, event_id: int
) -> None:
    """No display text, argument or language raises, also when events refer to each other."""
    events = {i: EventEntry(i, f"E{i}", Severity.INFO, text) for i in range(2)}
    found = EventClass(PUMP, "Pump", text, events, {text: {1031: german}}, hide_needless_arguments=hide)
    catalog = Catalog([found])
    assert isinstance(catalog.text(PUMP, event_id, given_arguments, language), str)
    assert isinstance(catalog.class_name(PUMP, language), str)


@given(text=texts, shown=st.lists(st.text(alphabet="abc", min_size=1, max_size=6), max_size=6))
def test_no_argument_is_lost(text: str, shown: list[str]) -> None:
    """Each argument stands in the text, in its place or in parentheses behind it."""
    catalog = Catalog([EventClass(PUMP, "Pump", events={0: EventEntry(0, "E", Severity.INFO, text)})])
    said = catalog.text(PUMP, 0, tuple(map(Argument.of, shown)))
    assert all(each in said for each in shown)


@given(text=st.text().filter(lambda text: text and "{" not in text))
def test_a_text_without_braces_says_itself(text: str) -> None:
    """Nothing else is special: no percent sign, no backslash."""
    catalog = Catalog([EventClass(PUMP, "Pump", events={0: EventEntry(0, "E", Severity.INFO, text)})])
    assert catalog.text(PUMP, 0) == text


DOCUMENT = (
    '<?xml version="1.0"?><TcModuleClass><Translations><Text TxtId="a"><Text LcId="1031">b</Text></Text></Translations>'
    "<DataTypes>"
    + "".join(
        f'<DataType><Name GUID="{{{guid}}}">Pump</Name><DisplayName TxtId=""><![CDATA[a]]></DisplayName>'
        '<EventId><Name Id="1">E</Name><DisplayName TxtId=""><![CDATA[t {0}]]></DisplayName><Severity>Info</Severity></EventId>'
        "</DataType>"
        for guid in (PUMP, OTHER)
    )
    + "</DataTypes></TcModuleClass>"
).encode()
SNIPPETS = [
    b"",
    b"<",
    b">",
    b"&",
    b"<!--",
    b"]]>",
    b"<![CDATA[",
    b"</DataType>",
    b"<DataType>",
    b"\xff",
    b"\x00",
    b"<!DOCTYPE a>",
    b'"',
]


@given(
    edits=st.lists(
        st.tuples(
            st.integers(0, len(DOCUMENT)), st.integers(0, 20), st.one_of(st.binary(max_size=4), st.sampled_from(SNIPPETS))
        ),
        min_size=1,
        max_size=4,
    )
)
def test_a_damaged_file_is_an_error_or_classes(edits: list[tuple[int, int, bytes]]) -> None:
    """Whatever is overwritten: TmcError, or whole classes and problems that say what was expected."""
    data = DOCUMENT
    for position, length, new in edits:
        data = data[:position] + new + data[position + length :]
    try:
        result = read_classes(data, "damaged.tmc")
    except TmcError as error:
        result = ReadResult((), (Problem(error.file, error.line, error.message),))
    assert all(problem.line >= 1 and "expected" in problem.message for problem in result.problems)
    assert all(each.guid and each.name and each.events for each in result.classes)
