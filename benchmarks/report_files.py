"""Numbers of a benchmark: from its command line to a JSON file, read back by the page."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from iptm_core.errors import IptmError
from iptm_core.state import FloatArray


def write_numbers(path: Path, numbers: Any) -> None:
    """Write what a benchmark measured."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")


def read_numbers(path: Path) -> Any:
    """Read what a benchmark measured, None if it was not run."""
    if not path.is_file():
        return None
    return json.loads(path.read_text(encoding="utf-8"))


def quantiles(values: FloatArray) -> dict[str, float]:
    """Return median, 99th percentile and largest value; nothing of no values."""
    if values.size == 0:
        return {}
    return {
        "median": float(np.median(values)),
        "p99": float(np.quantile(values, 0.99)),
        "max": float(values.max()),
    }


def run_benchmark(
    name: str,
    description: str | None,
    measure: Callable[..., Any],
    options: Mapping[str, tuple[Any, str]],
    arguments: Sequence[str] | None,
) -> int:
    """Measure by the command line, print the numbers and write them if asked to.

    Args:
        name: of the benchmark.
        description: text of ``--help``.
        measure: takes the options by name.
        options: default and help text by name; a default of None stands for an optional number, a tuple
            for an option that may be repeated.
        arguments: command line, None for that of the process.

    Returns:
        The exit code.
    """
    parser = argparse.ArgumentParser(prog=name, description=description)
    for option, (default, text) in options.items():
        repeated = isinstance(default, tuple)
        kind = str if repeated else float if default is None else type(default)
        parser.add_argument(
            f"--{option.replace('_', '-')}",
            type=kind,
            default=None if repeated else default,
            action="append" if repeated else "store",
            help=f"{text} ({', '.join(default) if repeated else default})",
        )
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    given = vars(parser.parse_args(arguments))
    path = given.pop("json")
    chosen = {key: options[key][0] if value is None else value for key, value in given.items()}
    try:
        numbers = measure(**chosen)
    except IptmError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    print(json.dumps(numbers, indent=1))
    if path is not None:
        write_numbers(path, numbers)
    return 0
