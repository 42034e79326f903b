"""Numbers of hand-written C stand in Python alone: no constant is declared twice."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from iptm_core.c_sources import CSources

SOURCES = Path(__file__).resolve().parents[2] / "ros2_ws" / "src"
FILES = sorted(SOURCES.glob("iptm_*/*/c/*.[ch]"))  # the C of an extra has no form in Python
LITERAL = re.compile(r"(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?=[fFuUlL]*\b)")
OF_FORMULAS = {"0.0", "0.25", "0.5", "1.0", "2.0", "3.0", "6.0", *map(str, range(10))}
"""Numbers of formulas, counts and places; the others have a meaning, hence a name."""
DECLARED = re.compile(
    r"^\s*(?:static )?const (?:volatile )?\w+ (\w+) = -?[\d.][\w.+-]*[;,]|^#define (\w+) -?[\d.]\S*$",
    re.MULTILINE,
)
ONLY_IN_C = {
    "bench.c": {
        "MOST_NODES",
        "8192",
        "ACCELERATION_TOLERANCE",
        "POWER_TOLERANCE",
        "500.0",
        "1e-12",
        "1e-9",
    },
    "clock.c": {"_POSIX_C_SOURCE", "199309", "1e-9"},
    "prices.c": {"TWO"},
    "real.h": {
        "IPTM_ROUND_OFF",
        "IPTM_VIOLATION_ROUND_OFF",
        "IPTM_LEAST_TOLERANCE",
        *("1e-4", "1e-5", "1e-6", "1e-10"),
    },
    "limiter.h": {"16", "32", "64"},
    "riccati.c": {"16"},
}
"""What has no form in Python, by file: of the test program, of the clock, of the precision, bits, room."""


def constants_in(text: str) -> Iterator[str]:
    """Return the constants that C code declares or uses without a name."""
    code = re.sub(r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"])*\"", " ", text, flags=re.DOTALL)
    for match in DECLARED.finditer(code):
        yield match[1] or match[2]
    yield from (literal for literal in LITERAL.findall(code) if literal not in OF_FORMULAS)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_no_constant_is_declared_in_c(path: Path) -> None:
    assert set(constants_in(path.read_text("ascii"))) == ONLY_IN_C.get(path.name, set())


@pytest.mark.parametrize(
    "line",
    [
        "static const double MARGIN_M = 1.0;",
        "static const int TRIALS = 3;",
        "#define MARGIN_M 2.0",
        "enum { KEPT = 12 };",
        "if (gap_m < 1.5) return;",
    ],
)
def test_an_added_constant_is_found(line: str) -> None:
    assert list(constants_in(f"#include <math.h>\n{line}\n"))


def test_a_constant_has_one_value(tmp_path: Path) -> None:
    """`iptm_core.lead_track` and the one of the controller's check have different resolutions."""
    (tmp_path / "a.c").write_text('#include "a_constants.h"\ndouble x = RESOLUTION_S;\n')
    both = CSources(tmp_path, {"a": ("iptm_core.lead_track", "iptm_controller.lead_check")})
    with pytest.raises(AssertionError, match="RESOLUTION_S"):
        both.read("a.c")
    one = CSources(tmp_path, {"a": ("iptm_core.lead_track",)}).read("a.c")
    assert one["a_constants.h"] == "/* Of iptm_core.lead_track. */\n#define RESOLUTION_S 1e-09\n"
