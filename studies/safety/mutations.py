"""Plants faults into the safety layer, one at a time, and runs its tests, one of which should fail.

Tests that pass whatever the code does prove nothing. The faults are listed in `mutations.yaml`: wrong
signs, missing terms, limits that bind nothing, conditions that never hold. With ``--drawn`` they are drawn
from all constants of its files (a quarter more) and all comparisons (turned round). Only a copy of a package
is changed.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent.parent
SOURCES = ROOT / "ros2_ws" / "src"
LIST = Path(__file__).with_suffix(".yaml")
ROUND_OFF = 1e-5
"""Constants up to this are tolerances of numbers that are equal."""
LONGEST_S = 300.0
"""A planted fault that keeps the tests from ending is caught as well."""


@dataclass(frozen=True)
class Planted:
    """A fault: ``old`` becomes ``new`` in a file of a package; and the tests to run.

    Attributes:
        at: where in the file; None wherever it stands.
    """

    package: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]
    at: int | None = None

    @property
    def source(self) -> Path:
        """The file without the fault."""
        return SOURCES / self.package / self.package / self.file

    def describe(self) -> str:
        """Return one line."""
        place = (
            "" if self.at is None else f":{self.source.read_text()[: self.at].count(chr(10)) + 1}"
        )
        return f"{self.package}/{self.file}{place}: {self.old} => {self.new}"

    def planted(self, text: str) -> str:
        """Return the text of the file with the fault."""
        if self.at is None:
            return text.replace(self.old, self.new)
        return text[: self.at] + self.new + text[self.at + len(self.old) :]

    def is_caught(self) -> bool:
        """Return whether the tests fail with the fault in place."""
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / self.package
            shutil.copytree(
                SOURCES / self.package / self.package,
                copy,
                ignore=shutil.ignore_patterns("__pycache__"),
            )
            changed = copy / self.file
            changed.write_text(self.planted(changed.read_text(encoding="utf-8")))
            path = os.pathsep.join(filter(None, (folder, os.environ.get("PYTHONPATH", ""))))
            options = [
                "-m",
                "not slow and not integration",
                "-q",
                "-x",
                "-n",
                "0",
                "-p",
                "no:cacheprovider",
                "--no-header",
            ]
            try:
                done = subprocess.run(  # noqa: S603
                    [sys.executable, "-m", "pytest", *options, *self.tests],
                    cwd=ROOT,
                    env={**os.environ, "PYTHONPATH": path},
                    capture_output=True,
                    timeout=LONGEST_S,
                    check=False,
                )
            except subprocess.TimeoutExpired:
                return True
        return done.returncode == 1 or done.returncode < 0


def planted_faults() -> Iterator[Planted]:
    """Return the faults in the order of the list."""
    listed = yaml.safe_load(LIST.read_text(encoding="utf-8"))
    for name, entry in listed.items():
        package, _, file = name.partition("/")
        for change in entry["planted"]:
            old, _, new = change.partition(" => ")
            yield Planted(package, file, old, new, tuple(entry["tests"]))


_TURNED = {"<": ">", ">": "<", "<=": ">=", ">=": "<=", "==": "!=", "!=": "=="}
_COMPARISON = re.compile(r" (<=|>=|<|>|==|!=) ")
_CONSTANT = re.compile(r"^_?[A-Z][A-Z0-9_, ]* = [^#\n]*", re.MULTILINE)
_NUMBER = re.compile(r"(?<![\w.])\d+\.?\d*(?:e-?\d+)?(?![\w.])")
_NO_CODE = re.compile(r'/\*.*?\*/|"(?:\\.|[^"\\\n])*"|"{3}.*?"{3}|#[^\n]*|for \([^)]*\)', re.DOTALL)


def drawn_faults(count: int, seed: int) -> list[Planted]:
    """Return faults drawn from all constants and comparisons of the listed files."""
    every = []
    for name, entry in yaml.safe_load(LIST.read_text(encoding="utf-8")).items():
        package, _, file = name.partition("/")
        found = Planted(package, file, "", "", tuple(entry["tests"]))
        code = _NO_CODE.sub(lambda match: " " * len(match[0]), found.source.read_text("utf-8"))
        every += [
            replace(found, at=match.start(1), old=match[1], new=_TURNED[match[1]])
            for match in _COMPARISON.finditer(code)
        ]
        for line in _CONSTANT.finditer(code):
            for number in _NUMBER.finditer(line[0]):
                value = float(number[0])
                if 0.0 < value <= ROUND_OFF:
                    continue
                new = str(int(value) + 1) if number[0].isdigit() else repr(1.25 * value)
                at = line.start() + number.start()
                every.append(replace(found, at=at, old=number[0], new=new))
    return random.Random(seed).sample(every, count)  # noqa: S311


def measure(faults: Sequence[Planted], least_share: float) -> int:
    """Plant faults and print which are not caught; return the exit code."""
    missed = []
    for number, fault in enumerate(faults, start=1):
        caught = fault.is_caught()
        print(
            f"[{number}/{len(faults)}] {'caught' if caught else 'MISSED'} {fault.describe()}",
            flush=True,
        )
        if not caught:
            missed.append(fault)
    share = 1.0 - len(missed) / len(faults)
    print(f"{len(faults) - len(missed)} of {len(faults)} planted faults are caught ({share:.1%})")
    for fault in missed:
        print(f"missed: {fault.describe()}")
    return 0 if share >= least_share else 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--short", action="store_true", help="one fault of each file")
    parser.add_argument("--drawn", type=int, default=0, help="number of faults that are drawn")
    parser.add_argument("--seed", type=int, default=1, help="of the draw")
    parser.add_argument("--only", default="", help="faults of files whose name contains this")
    parser.add_argument(
        "--least-share", type=float, default=0.95, help="share that has to be caught"
    )
    given = parser.parse_args(arguments)
    every = drawn_faults(given.drawn, given.seed) if given.drawn else planted_faults()
    faults = [fault for fault in every if given.only in f"{fault.package}/{fault.file}"]
    if given.short:
        faults = list({fault.file: fault for fault in faults}.values())
    return measure(faults, given.least_share)


if __name__ == "__main__":
    sys.exit(main())
