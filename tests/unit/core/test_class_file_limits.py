"""Hostile and huge class files: a clear error or the whole content, under 2 s and 300 MB each.

Each case runs in a process of its own, which the kernel stops at 2 s of its own computing time and 600 MB of addresses; what it
held in memory at most is measured by the kernel too. Other programs on the machine do not count.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SHARED = Path(os.environ.get("TCBRIDGE_SHARED", Path(__file__).parents[3].parent / "shared")) / "data" / "tmc"
SECONDS = 2
MEGABYTES = 300

CHILD = f"""
import resource, sys
from bridge.core import class_toml, tmc, translations

def told(read, data):
    try:
        result = read(data, "file")
    except tmc.TmcError as error:
        print("refused", error)
    else:
        events = sum(len(found.events) for found in result.classes)
        print("read", len(result.classes), events, result.problems[0] if result.problems else "")

def event(i, text="text of event"):
    return (
        f'<EventId><Name Id="{{i}}">Event{{i}}</Name><DisplayName TxtId=""><![CDATA[{{text}} {{i}}: {{{{0}}}}]]></DisplayName>'
        "<Severity>Error</Severity></EventId>"
    )

def document(body, root="TcModuleClass", head='<?xml version="1.0"?>'):
    return f"{{head}}<{{root}}>{{body}}</{{root}}>".encode()

def data_type(*events):
    name = '<Name GUID="{{54CC5482-AD79-4CDC-8C3E-B3983B36ED66}}">Pump</Name><DisplayName TxtId="">Pumps</DisplayName>'
    return f"<DataTypes><DataType>{{name}}{{''.join(events)}}</DataType></DataTypes>"

resource.setrlimit(resource.RLIMIT_CPU, ({SECONDS} + 1, {SECONDS} + 1))
resource.setrlimit(resource.RLIMIT_AS, (600_000_000, 600_000_000))
exec(sys.stdin.read())
usage = resource.getrusage(resource.RUSAGE_SELF)
# Not ru_maxrss: it begins with the size of the process that started this one.
(peak,) = [line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM:")]
print(f"{{usage.ru_utime + usage.ru_stime:.2f}} s, {{int(peak) / 1000:.0f}} MB")
"""


def run(program: str) -> list[str]:
    """What the program says, when it stayed within the limits."""
    done = subprocess.run([sys.executable, "-c", CHILD], input=program, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    *lines, usage = done.stdout.splitlines()
    seconds, megabytes = (float(each.split()[0]) for each in usage.split(", "))
    assert seconds < SECONDS, usage
    assert megabytes < MEGABYTES, usage
    return lines


LAUGHS = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
CASES = {
    "billion laughs": (
        f"told(tmc.read_classes, document('&e11;', head='<!DOCTYPE TcModuleClass [<!ENTITY e0 \"ha\">{LAUGHS}]>'))",
        "refused file:1: a DTD is refused; expected a file without DOCTYPE",
    ),
    "external entity": (
        "told(tmc.read_classes, document('&x;', head='<!DOCTYPE x [<!ENTITY x SYSTEM \"file:///etc/passwd\">]>'))",
        "refused file:1: a DTD is refused; expected a file without DOCTYPE",
    ),
    "depth 200,000": (
        "told(tmc.read_classes, document(data_type(event(1)) + '<a>' * 200_000 + '</a>' * 200_000))",
        "read 1 1 file:1: Excessive depth in document: 256",
    ),
    "wrong encoding": (
        "told(tmc.read_classes, document(data_type(event(1, 'Überdruck')), head='<?xml version=\"1.0\" encoding=\"UTF-8\"?>')"
        ".decode().encode('latin-1'))",
        "read 0 0 file:1: ",
    ),
    "unknown encoding": (
        'told(tmc.read_classes, document(data_type(event(1)), head=\'<?xml version="1.0" encoding="klingon"?>\'))',
        "refused file:1: Unsupported encoding: klingon",
    ),
    "100,000 events": ("told(tmc.read_classes, document(data_type(*map(event, range(100_000)))))", "read 1 100000 "),
    "100,000 events in a broken file": (
        "told(tmc.read_classes, document(data_type(*map(event, range(100_000))) + '&nope;'))",
        "read 1 100000 file:1: Entity 'nope' not defined",
    ),
    "100,000 translations": (
        'texts = (f\'<Text TxtId="text {i}"><Text LcId="1031">Text {i}</Text></Text>\' for i in range(100_000));'
        "print(len(translations.read_xml(document(''.join(texts), 'Translations'))['']))",
        "100000",
    ),
    "100,000 rows": (
        "rows = (f',,text {i},Text {i}\\n' for i in range(100_000));"
        "print(len(translations.read_csv(('class,guid,text,de\\n' + ''.join(rows)).encode())['']))",
        "100000",
    ),
    "TOML of 100,000 events": (
        "told(class_toml.read_classes, b'[[classes]]\\nname = \"x\"\\n' + b'[[classes.events]]\\nid = 1\\n' * 100_000)",
        "refused file:1: 2600023 bytes; expected at most 1000000",
    ),
    "TOML of the greatest size": (
        'events = (f\'[[classes.events]]\\nid = {i}\\nname = "E{i}"\\nseverity = "info"\\n\' for i in range(15_900));'
        "told(class_toml.read_classes, ('[[classes]]\\nname = \"x\"\\n' + ''.join(events)).encode())",
        "read 1 15900 ",
    ),
    "TOML of depth 200,000": (
        "told(class_toml.read_classes, b'x = ' + b'[' * 200_000)",
        "refused file:1: nested too deep; expected a TOML file of event classes",
    ),
    "TOML of a key of 200,000 parts": (
        "told(class_toml.read_classes, b'a.' * 200_000 + b'a = 1')",
        "refused file:1: a key of more than 16 parts; expected a TOML file of event classes",
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_a_clear_error_or_the_whole_content(name: str) -> None:
    """Under 2 s and 300 MB."""
    program, said = CASES[name]
    (line,) = run(program)
    assert line.startswith(said)


@pytest.mark.skipif(not SHARED.is_dir(), reason=f"the real class files are not in {SHARED}; TCBRIDGE_SHARED names their folder")
@pytest.mark.parametrize("name", ["aag-test-bench.tsproj", "packml-vffs-demo.tmc", "beckhoff-start-stop.tmc"])
def test_a_real_file_cut_at_every_100th_byte(name: str) -> None:
    """All cuts together stay within what one is allowed: an error, or the first classes and a problem."""
    program = f"""
data = open({str(SHARED / name)!r}, "rb").read()
whole = tmc.read_classes(data).classes
refused, read = 0, set()
for end in range(0, len(data), 100):
    try:
        result = tmc.read_classes(data[:end], "file")
    except tmc.TmcError as error:
        assert str(error).startswith("file:") and "; expected " in str(error), error
        refused += 1
    else:
        assert result.classes == whole[: len(result.classes)] and result.problems, end
        read.add(len(result.classes))
print(refused > 0, read == set(range(max(read) + 1)), max(read) >= len(whole) - 1)
"""
    assert run(program) == ["True True True"]
