"""Plants faults into the safety layer, one at a time, and runs its tests, one of which should fail.

Tests that pass whatever the code does prove nothing. The faults are listed in `mutations.yaml`: wrong
signs, missing terms, limits that bind nothing, conditions that never hold. Only a copy of a package is
changed.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parent.parent.parent
SOURCES = ROOT / "ros2_ws" / "src"
LIST = Path(__file__).with_suffix(".yaml")
LONGEST_S = 300.0
"""A planted fault that keeps the tests from ending is caught as well."""


@dataclass(frozen=True)
class Planted:
    """A fault: ``old`` becomes ``new`` wherever it stands in a file of a package; and the tests to run."""

    package: str
    file: str
    old: str
    new: str
    tests: tuple[str, ...]

    @property
    def source(self) -> Path:
        """The file without the fault."""
        return SOURCES / self.package / self.package / self.file

    def describe(self) -> str:
        """Return one line."""
        return f"{self.package}/{self.file}: {self.old} => {self.new}"

    def is_caught(self) -> bool:
        """Return whether the tests fail with the fault in place."""
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / self.package
            shutil.copytree(self.source.parent, copy, ignore=shutil.ignore_patterns("__pycache__"))
            changed = copy / self.file
            changed.write_text(changed.read_text(encoding="utf-8").replace(self.old, self.new))
            path = os.pathsep.join(filter(None, (folder, os.environ.get("PYTHONPATH", ""))))
            options = ["-q", "-x", "-n", "0", "-p", "no:cacheprovider", "--no-header"]
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
        return done.returncode == 1


def planted_faults() -> Iterator[Planted]:
    """Return the faults in the order of the list."""
    listed = yaml.safe_load(LIST.read_text(encoding="utf-8"))
    for name, entry in listed.items():
        package, _, file = name.partition("/")
        for change in entry["planted"]:
            old, _, new = change.partition(" => ")
            yield Planted(package, file, old, new, tuple(entry["tests"]))


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
    parser.add_argument("--only", default="", help="faults of files whose name contains this")
    parser.add_argument(
        "--least-share", type=float, default=0.95, help="share that has to be caught"
    )
    given = parser.parse_args(arguments)
    faults = [fault for fault in planted_faults() if given.only in f"{fault.package}/{fault.file}"]
    if given.short:
        faults = list({fault.file: fault for fault in faults}.values())
    return measure(faults, given.least_share)


if __name__ == "__main__":
    sys.exit(main())
