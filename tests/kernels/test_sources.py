"""What no kernel may say: nothing that a device without double cannot do, or may do inexactly."""

from __future__ import annotations

import re

import pytest

from tests.repository import ROOT, tracked_files

SOURCES = {
    str(path): (ROOT / path).read_text()
    for path in tracked_files()
    if path.parts[0] == "cl_kernels" and path.suffix in {".cl", ".h"}
}

COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
DOUBLE = re.compile(r"\b(double(2|3|4|8|16)?|convert_double\w*|as_double\w*|cl_khr_fp64)\b")
# A point with a digit beside it, or an exponent, or hexadecimal with a binary exponent.
FLOAT = re.compile(
    r"""(?<![\w.])(
        0[xX][\da-fA-F]*\.?[\da-fA-F]*[pP][+-]?\d+
      | (\d+\.\d*|\.\d+)([eE][+-]?\d+)?
      | \d+[eE][+-]?\d+
    )(?P<suffix>\w*)""",
    re.VERBOSE,
)
INEXACT = ("-cl-fast-relaxed-math", "-cl-mad-enable", "-cl-unsafe-math-optimizations")


def code_of(source: str) -> str:
    """The source without its comments, its lines where they were."""
    return COMMENT.sub(lambda comment: "\n" * comment.group().count("\n") or " ", source)


def faults(source: str) -> list[str]:
    """What a device without double would refuse, or silently widen, with line numbers."""
    found = []
    for number, line in enumerate(code_of(source).splitlines(), 1):
        found += [f"{number}: {match.group()}" for match in DOUBLE.finditer(line)]
        found += [
            f"{number}: {match.group()}"
            for match in FLOAT.finditer(line)
            if match["suffix"] not in {"f", "F"}
        ]
    return found


@pytest.mark.parametrize("name", SOURCES)
def test_kernel_is_free_of_double(name: str) -> None:
    """Neither the type nor a literal of it."""
    assert faults(SOURCES[name]) == []


@pytest.mark.parametrize("name", SOURCES)
def test_kernel_lines_are_as_short_as_those_of_python(name: str) -> None:
    assert max(map(len, SOURCES[name].splitlines())) <= 100


@pytest.mark.parametrize("name", [name for name in SOURCES if name.endswith(".cl")])
def test_kernel_says_where_its_relatives_are(name: str) -> None:
    """Host, twin and tests are named in its header, and are there; NumPy may be the twin."""
    for label in ("Host", "Reference", "Tests"):
        match = re.search(rf"^ \* {label}: +([^\s,]+)", SOURCES[name], re.MULTILINE)
        assert match, f"{name} has no line '{label}:'"
        known = (ROOT / match[1]).is_file() or match[1].startswith("numpy.")
        assert known, f"{name} names {match[1]}, which is not there"


def absent_names(source: str) -> list[str]:
    """Functions and classes of a header's Host and Reference that its Python files do not have."""
    found = []
    for label in ("Host", "Reference"):
        match = re.search(rf"^ \* {label}: +(\S+\.py), (.+)", source, re.MULTILINE)
        if match is None or match[1].startswith("tests/"):
            continue
        text = (ROOT / match[1]).read_text()
        # Functions end in (); a word that is all there is names a class; other words are words.
        names = re.findall(r"([\w.]+)\(\)", match[2]) or re.findall(r"^\w+$", match[2])
        for name in names:
            lines = [rf"^ *(def|class) {part}\b" for part in name.split(".")]
            if not all(re.search(line, text, re.MULTILINE) for line in lines):
                found.append(f"{match[1]}: {name}")
    return found


@pytest.mark.parametrize("name", [name for name in SOURCES if name.endswith(".cl")])
def test_kernel_names_functions_that_are_there(name: str) -> None:
    assert absent_names(SOURCES[name]) == []


@pytest.mark.parametrize(
    ("line", "absent"),
    [
        ("clvox/ops/bins.py, Binner", []),
        ("clvox/ops/bins.py, Bin", ["Bin"]),
        ("clvox/ops/bins.py, visit(), bin_triangles()", ["bin_triangles"]),
        ("clvox/device/session.py, Session.zeros()", []),
        ("clvox/device/session.py, Session.ones()", ["Session.ones"]),
        ("clvox/ops/sorting.py, sort_rows() and others", []),
        ("clvox/ops/sorting.py", []),
    ],
)
def test_scan_finds_names_that_are_not_there(line: str, absent: list[str]) -> None:
    found = absent_names(f"/*\n * Host:       {line}\n */")
    assert found == [f"{line.split(',', maxsplit=1)[0]}: {name}" for name in absent]


def test_no_inexact_arithmetic_is_asked_for() -> None:
    """Such options let a compiler reorder what decides geometry."""
    texts = {
        path: (ROOT / path).read_text()
        for path in tracked_files()
        if path.parts[0] in {"clvox", "cl_kernels"} and path.suffix in {".py", ".cl", ".h"}
    }
    found = [(path, option) for path, text in texts.items() for option in INEXACT if option in text]
    assert found == []


@pytest.mark.parametrize(
    "source",
    ["double x;", "a = 1.0;", "a = .5 * b;", "a = 2. * b;", "a = 1e-3;", "a = 0x1p-3;", "a=1.5e3L;",
     "b = convert_double2(a);", "/* 1.0f */ a = 1.0; // f"],
)  # fmt: skip
def test_scan_finds(source: str) -> None:
    """A scan that finds nothing anywhere would pass every kernel."""
    assert faults(source) != []


@pytest.mark.parametrize(
    "source",
    ["float a = 1.0f;", "a = .5f;", "a = 1e-3f;", "a = 0x1p-3f;", "v.x0 = v.s1;", "a = 0x1e3;",
     "// a double, 1.0", "/* 2.0\n double */ int a = 10;", "ulong n = 10UL;", "x.lo.y = 0xEul;"],
)  # fmt: skip
def test_scan_passes(source: str) -> None:
    """Integers, vector parts and comments are no doubles."""
    assert faults(source) == []
