"""Limiter and safety monitor in C: their mutants, the lines that the cases reach, findings of MISRA."""

from __future__ import annotations

import ctypes
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from studies.embedded.safeguard_cases import PARAMETERS, Case, all_cases, loaded

from iptm_controller.options import ControllerOptions
from iptm_ecu.codegen import code_of

SOURCES = ("limiter.c", "safety_monitor.c")
ROOT = Path(__file__).resolve().parents[2]
ADVISORY = frozenset(
    re.findall(
        r"[\d.]+",
        "1.2 2.3 2.4 2.5 2.6 2.7 2.8 4.2 5.9 8.7 8.9 8.11 8.13 8.16 8.17 10.5 11.4 11.5 12.1 12.3 "
        "12.4 13.3 13.4 15.1 15.4 15.5 17.5 17.8 17.11 17.12 18.4 18.5 19.2 20.1 20.5 20.10 21.12 "
        "23.1 23.3 23.5 23.7",
    )
)
"""Rules of MISRA C:2012 that are not required, by the table in ``lib/checkers.cpp`` of Cppcheck (2023)."""


def write_sources(folder: Path) -> None:
    """Write the files of a controller into a folder that is there."""
    for name, text in code_of(PARAMETERS, ControllerOptions()).items():
        (folder / name).write_text(text)


def built(folder: Path, name: str) -> ctypes.CDLL:
    """Compile limiter and monitor into a library and load it."""
    command = ["cc", "-std=c99", "-w", "-O0", "-ffp-contract=off", "-fPIC", "-shared"]
    command += [*SOURCES, "-o", name, "-lm"]
    subprocess.run(command, cwd=folder, check=True, timeout=60, capture_output=True)  # noqa: S603
    return loaded(folder / name)


@dataclass(frozen=True)
class Mutant:
    """A change of one place in a source."""

    source: str
    line: int
    before: str
    after: str

    @property
    def change(self) -> str:
        """The line before and after it, in Markdown for a table."""
        return f"`{self.before.strip()}` → `{self.after.strip()}`".replace("|", r"\|")


_CHANGES = (
    (r" <= ", (" < ", " > ")),
    (r" < ", (" <= ", " >= ")),
    (r" >= ", (" > ", " < ")),
    (r" > ", (" >= ", " <= ")),
    (r" != ", (" == ",)),
    (r" \+ ", (" - ",)),
    (r" - ", (" + ",)),
    (r" \* ", (" / ",)),
    (r" / ", (" * ",)),
    (r" \+= ", (" -= ", " = ")),
    (r" \|= ", (" = ", " &= ")),
    (r" && ", (" || ",)),
    (r" \|\| ", (" && ",)),
    (r"!(?=[\w(])", ("",)),
    (r"(?<=[(,=?] )-(?=\w)|(?<=\()-(?=\w)|(?<=return )-(?=\w)", ("",)),
    (r"\blarger\((?!double)", ("smaller(",)),
    (r"\bsmaller\((?!double)", ("larger(",)),
    (r"\btrue\b", ("false",)),
    (r"\b\d+\.\d+(?:e-\d+)?\b|\b\de-\d+\b", ("(2.0 * (\\g<0>) + 1e-3)",)),
    (r"^( +)(?:return;|[\w>*-]+ [|+]?= .*;)$", ("\\1;",)),
)


def mutants(name: str, text: str) -> Iterator[Mutant]:
    """Yield the mutants of a source, a change at every place that a rule fits."""
    for number, line in enumerate(text.splitlines()):
        if line.startswith(("#", "/*", " *")) or line.strip().startswith("/*"):
            continue
        for pattern, afters in _CHANGES:
            for found in re.finditer(pattern, line):
                for after in afters:
                    changed = line[: found.start()] + found.expand(after) + line[found.end() :]
                    yield Mutant(name, number, line, changed)


def is_killed(folder: Path, mutant: Mutant, text: str, cases: Sequence[Case], name: str) -> bool:
    """Return whether a case fails on a mutant; one that cannot be compiled is killed as well."""
    lines = text.splitlines()
    lines[mutant.line] = mutant.after
    (folder / mutant.source).write_text("\n".join([*lines, ""]))
    try:
        library = built(folder, name)
    except subprocess.CalledProcessError:
        return True
    finally:
        (folder / mutant.source).write_text(text)
    return not all(case.holds(library) for case in cases)


EQUIVALENT = {
    "raised = low >= value ?": "two equal numbers",
    "return high <= raised ?": "two equal numbers",
    "last_acceleration <= 0.0 ?": "zero either way",
    "changed = IPTM_LIMIT_ACCELERATION_NOT_FINITE": "the first bit that is set",
    "lowest >= to_top_speed ?": "two equal numbers",
    "return second >= first ?": "two equal numbers",
    "return second <= first ?": "two equal numbers",
    "if (a >= -deceleration_m_s2)": "the brakes rise for 0 s",
    "if (after < 0.0)": "the same time, as the speed ends at 0 with the rise",
    "return;` → `;": "what follows writes the same values while it brakes",
}
"""Why a mutant that no case kills does the same, by what it changes to."""


def survivors(folder: Path, source: str) -> tuple[int, list[Mutant]]:
    """Return the number of mutants of a source, and those that no case kills."""
    text = (folder / source).read_text()
    cases = [case for case in all_cases() if ("limit" in case.function) == (source == SOURCES[0])]
    every = list(mutants(source, text))
    left = [
        mutant
        for place, mutant in enumerate(every)
        if not is_killed(folder, mutant, text, cases, f"{source}_{place}.so")
    ]
    return len(every), left


def lines_covered(folder: Path) -> dict[str, str]:
    """Return the share of each source's lines that the cases reach, and their number, as gcov prints them."""
    command = ["gcc", "--coverage", "-O0", "-fPIC", "-c", *SOURCES]
    subprocess.run(command, cwd=folder, check=True, timeout=60)  # noqa: S603
    objects = [name.replace(".c", ".o") for name in SOURCES]
    command = ["gcc", "--coverage", "-shared", *objects, "-o", "covered.so", "-lm"]
    subprocess.run(command, cwd=folder, check=True, timeout=60)  # noqa: S603
    # Counts are written when a process ends.
    call = [sys.executable, "-m", "studies.embedded.safeguard_cases", str(folder / "covered.so")]
    subprocess.run(call, cwd=ROOT, check=True, timeout=300)  # noqa: S603
    command = ["gcov", "-n", *SOURCES]
    found = subprocess.run(  # noqa: S603
        command, cwd=folder, check=True, capture_output=True, text=True, timeout=60
    ).stdout
    return dict(re.findall(r"^File '(.+)'\nLines executed:(.*)", found, re.MULTILINE))


def misra_findings(folder: Path) -> dict[str, int]:
    """Return the number of findings of the MISRA add-on of Cppcheck, by rule."""
    command = ["cppcheck", "--addon=misra", "--std=c99", "--enable=style", "-q", *SOURCES]
    checked = subprocess.run(  # noqa: S603
        command, cwd=folder, check=True, capture_output=True, text=True, timeout=100
    ).stderr
    return dict(Counter(re.findall(r"misra-c2012-([\d.]+)", checked)))
