"""The folder of a run: bag, picture, results and logs."""

from __future__ import annotations

import os
import shutil
from datetime import datetime
from itertools import count
from pathlib import Path

from iptm_core.errors import ScenarioError
from iptm_core.user_input import shown

PICTURE = "closed_loop.png"
REPORT = "report.html"
RESULTS = "results.json"
REFERENCE = "reference.parquet"
LOGS = "logs"
LONGEST_NAME = 200
"""Bytes; file systems take 255, and the names of files inside are longer."""


def default_output(scenario_name: str) -> Path:
    """Return a folder under ``bags/`` of the project, or of the current folder outside it."""
    now = datetime.now().astimezone()
    root = Path(os.environ.get("IPTM_ROOT", "."))
    return root / "bags" / f"{scenario_name}_{now:%Y%m%d_%H%M%S}"


class RunFolder:
    """Where a run puts its files: a folder created here, so that no other run has it.

    Attributes:
        given: the folder as the user wrote it.
        output: its absolute path; a rosbag2 bag if the run is recorded.
        logs: folder of the logs in it.
        picture: path of the picture.
        report: path of the page of the run.
        results: path of the results.
        reference: path of the trajectory of the run that this one is compared with.
    """

    def __init__(self, given: Path, *, numbered: bool = False) -> None:
        """Create the folder.

        Args:
            given: the folder.
            numbered: take ``<given>_2``, ``<given>_3``, ... where it exists.

        Raises:
            ScenarioError: it exists, or cannot be created.
        """
        # The bag inside is named after the folder.
        if len(os.fsencode(given.name)) > LONGEST_NAME:
            raise ScenarioError(
                f"the name of the output folder has {len(os.fsencode(given.name))} bytes;"
                f" allowed: up to {LONGEST_NAME}"
            )
        try:
            given.parent.mkdir(parents=True, exist_ok=True)
            self.given = _created(given, numbered=numbered)
            self.output = self.given.absolute()
            self.logs = self.output / LOGS
            self.picture = self.output / PICTURE
            self.report = self.output / REPORT
            self.results = self.output / RESULTS
            self.reference = self.output / REFERENCE
            self.logs.mkdir()
        except OSError as error:
            where = shown(str(given.parent))
            raise ScenarioError(f"cannot write to {where}: {error.strerror}") from None

    @classmethod
    def of_run(cls, given: Path | None, name: str) -> RunFolder:
        """Create the folder that the user named, or one named after the run."""
        return cls(given) if given is not None else cls(default_output(name), numbered=True)

    def log_path(self, name: str) -> Path:
        """Return the file for the output of a process."""
        return self.logs / f"{name}.log"

    def write_log(self, name: str, text: str) -> Path:
        """Write a file next to the logs; return its path."""
        path = self.logs / name
        path.write_text(text, encoding="utf-8")
        return path

    def discard(self) -> None:
        """Remove everything: nothing was driven."""
        shutil.rmtree(self.output, ignore_errors=True)


def _created(folder: Path, *, numbered: bool) -> Path:
    """Create a folder, which only one process can do; return it, with a number if it existed."""
    created = folder
    for number in count(2):
        try:
            created.mkdir()
            break
        except FileExistsError:
            if not numbered:
                raise ScenarioError(
                    f"{folder} exists already; a run never overwrites another one"
                ) from None
        created = folder.with_name(f"{folder.name}_{number}")
    return created
