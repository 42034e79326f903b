"""What measurements of speed share: a command line, quantiles, and the machine in a line."""

from __future__ import annotations

import argparse
import inspect
import json
import os
import platform
import re
import sys
from collections.abc import Callable, Sequence
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any, get_args, get_origin

import numpy as np

from iptm_core.errors import IptmError
from iptm_core.state import FloatArray


def quantiles(values: FloatArray) -> dict[str, float]:
    """Return median, 99th percentile and largest value; nothing of no values."""
    if values.size == 0:
        return {}
    return {
        "median": float(np.median(values)),
        "p99": float(np.quantile(values, 0.99)),
        "max": float(values.max()),
    }


def spread(name: str, form: str, largest: str = "max") -> str:
    """Return the format of a cell with median, 99th percentile and largest value."""
    return " / ".join(f"{{{name}[{key}]:{form}}}" for key in ("median", "p99", largest))


def run_benchmark(
    measure: Callable[..., Any],
    arguments: Sequence[str] | None = None,
    text_of: Callable[[Any], str] = lambda numbers: json.dumps(numbers, indent=1),
) -> int:
    """Measure by the command line and print the numbers.

    Args:
        measure: its parameters become the options and its docstring their help; a tuple may be repeated.
        arguments: command line, None for the one of the process.
        text_of: what is printed of the numbers.

    Returns:
        The exit code.
    """
    name = Path(inspect.getfile(measure)).stem
    parser = argparse.ArgumentParser(prog=name, description=inspect.getmodule(measure).__doc__)
    helps = dict(re.findall(r"^ +(\w+): (.+)\.$", measure.__doc__ or "", re.MULTILINE))
    for option, parameter in inspect.signature(measure, eval_str=True).parameters.items():
        kind = (get_args(parameter.annotation) or (parameter.annotation,))[0]
        repeated = get_origin(parameter.annotation) is tuple
        usual = ", ".join(parameter.default) if repeated else parameter.default
        action = "append" if repeated else "store"
        text = f"{helps[option]} ({usual})"
        parser.add_argument(f"--{option.replace('_', '-')}", type=kind, action=action, help=text)
    given = vars(parser.parse_args(arguments))
    try:
        numbers = measure(**{key: value for key, value in given.items() if value is not None})
    except IptmError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    print(text_of(numbers))
    return 0


def machine_in_words() -> str:
    """Return date, processor, load and versions in a sentence, without the name of the machine."""
    found = re.search(
        r"^model name\s*: (.*)$", Path("/proc/cpuinfo").read_text("utf-8"), re.MULTILINE
    )
    processor = found[1] if found else platform.processor()
    return (
        f"Measured on {datetime.now(timezone.utc):%Y-%m-%d} on {os.cpu_count()} cores of {processor}, "
        f"load average {os.getloadavg()[0]:.1f} at the end; {platform.system()} {platform.machine()}, Python "
        f"{platform.python_version()}, CasADi {metadata.version('casadi')}, NumPy {np.__version__}."
    )
