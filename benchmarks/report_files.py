"""Numbers of a benchmark as a JSON file, read back by the page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def write_numbers(path: Path, numbers: Any) -> None:
    """Write what a benchmark measured."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")


def read_numbers(path: Path) -> Any:
    """Read what a benchmark measured, None if it was not run."""
    if not path.is_file():
        return None
    return json.loads(path.read_text(encoding="utf-8"))


def finish(numbers: Any, path: Path | None) -> int:
    """Print the numbers and write them if asked to; returns the exit code of a benchmark that ran."""
    print(json.dumps(numbers, indent=1))
    if path is not None:
        write_numbers(path, numbers)
    return 0
