"""The folder of a run: the bag, and beside it picture, results and logs.

The recorder wants to create the folder itself, but logs are written before it starts. They begin in a
hidden folder next door and move in as soon as there is a folder to move into; open files follow.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from datetime import datetime
from pathlib import Path

from iptm_core.errors import ScenarioError
from iptm_core.strict_mapping import shown

PICTURE = "closed_loop.png"
RESULTS = "results.json"
LOGS = "logs"
LONGEST_NAME = 200
"""Bytes; file systems take 255, and the names of files inside are longer."""


def default_output(scenario_name: str) -> Path:
    """Return a new folder under ``bags/`` of the project, or of the current folder outside it."""
    now = datetime.now().astimezone()
    root = Path(os.environ.get("IPTM_ROOT", "."))
    return root / "bags" / f"{scenario_name}_{now:%Y%m%d_%H%M%S}"


class RunFolder:
    """Where a run puts its files.

    Attributes:
        output: the folder, which is a rosbag2 bag if the run is recorded.
    """

    def __init__(self, output: Path) -> None:
        """Claim a folder that does not exist yet.

        Raises:
            ScenarioError: it exists, or nothing can be written next to it.
        """
        self.output = output.absolute()
        # The bag inside is named after the folder.
        if len(os.fsencode(self.output.name)) > LONGEST_NAME:
            raise ScenarioError(
                f"the name of the output folder has {len(os.fsencode(self.output.name))} bytes;"
                f" allowed: up to {LONGEST_NAME}"
            )
        try:
            if self.output.exists():
                raise ScenarioError(f"{output} exists already; a run never overwrites another one")
            self.output.parent.mkdir(parents=True, exist_ok=True)
            hidden = tempfile.mkdtemp(prefix=f".{self.output.name}.", dir=self.output.parent)
        except OSError as error:
            where = shown(str(output.parent))
            raise ScenarioError(f"cannot write to {where}: {error.strerror}") from None
        self.logs = Path(hidden)

    @property
    def picture(self) -> Path:
        """Path of the picture."""
        return self.output / PICTURE

    @property
    def results(self) -> Path:
        """Path of the results."""
        return self.output / RESULTS

    def log_path(self, name: str) -> Path:
        """Return the file for the output of a process."""
        return self.logs / f"{name}.log"

    def write_log(self, name: str, text: str) -> Path:
        """Write a file beside the logs; return its path."""
        path = self.logs / name
        path.write_text(text, encoding="utf-8")
        return path

    def settle(self) -> None:
        """Move the logs into the folder, creating it if nobody has; a second call is free."""
        if self.logs.parent == self.output:
            return
        self.output.mkdir(exist_ok=True)
        # A temporary folder is for its owner's eyes only, a run is for everyone.
        self.logs.chmod(self.output.stat().st_mode)
        self.logs = self.logs.rename(self.output / LOGS)

    def discard(self) -> None:
        """Remove everything: nothing was driven."""
        for folder in (self.logs, self.output):
            shutil.rmtree(folder, ignore_errors=True)
