"""What all benchmarks share: the command line, tables, quantiles, and the machine in a line."""

from __future__ import annotations

import argparse
import inspect
import json
import os
import platform
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, get_args, get_origin

import casadi as ca
import numpy as np

from iptm.parts import FloatArray, IptmError, StoreError


def quantiles(values: FloatArray) -> dict[str, float]:
    """Return median, 99th percentile and largest value; nothing of no values."""
    if values.size == 0:
        return {}
    return {
        "median": float(np.median(values)),
        "p99": float(np.quantile(values, 0.99)),
        "max": float(values.max()),
    }


def put(page: str, name: str, text: str) -> str:
    """Return a page with a text between its two marks.

    Raises:
        StoreError: the page lacks the marks.
    """
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    if begin not in page or end not in page:
        raise StoreError(f"the page has no marks {begin.strip()} and {end}; allowed: both of them")
    head, rest = page.split(begin, 1)
    return f"{head}{begin}\n{text.strip()}\n\n{end}{rest.split(end, 1)[1]}"


def run_benchmark(
    measure: Callable[..., Any],
    arguments: Sequence[str] | None = None,
    text_of: Callable[[Any], str | Mapping[str, str]] = lambda numbers: json.dumps(
        numbers, indent=1
    ),
    page: Path | None = None,
) -> int:
    """Measure by the command line, print the numbers and write them if asked to.

    Args:
        measure: its parameters become the options and its docstring their help; one without a default
            becomes a positional argument, a tuple may be repeated.
        arguments: command line, None for that of the process.
        text_of: what is printed of the numbers; for a page, texts by the names of their marks.
        page: file that the texts are written to if asked for.

    Returns:
        The exit code.
    """
    name = Path(inspect.getfile(measure)).stem
    parser = argparse.ArgumentParser(prog=name, description=inspect.getmodule(measure).__doc__)
    helps = dict(re.findall(r"^ +(\w+): (.+)\.$", measure.__doc__ or "", re.MULTILINE))
    options = inspect.signature(measure, eval_str=True).parameters
    for option, parameter in options.items():
        kind = (get_args(parameter.annotation) or (parameter.annotation,))[0]
        repeated = get_origin(parameter.annotation) is tuple
        if parameter.default is parameter.empty:
            many: dict[str, Any] = {"nargs": "+"} if repeated else {}
            parser.add_argument(option, type=kind, help=helps[option], **many)
            continue
        usual = ", ".join(parameter.default) if repeated else parameter.default
        parser.add_argument(
            f"--{option.replace('_', '-')}",
            type=kind,
            action="append" if repeated else "store",
            help=f"{helps[option]} ({usual})",
        )
    parser.add_argument("--json", type=Path, help="also write the numbers here")
    if page is not None:
        parser.add_argument("--page", type=int, default=0, help=f"1 writes docs/{page.name} (0)")
    given = vars(parser.parse_args(arguments))
    path = given.pop("json")
    writes_page = page is not None and given.pop("page")
    try:
        numbers = measure(**{key: value for key, value in given.items() if value is not None})
    except IptmError as error:
        print(f"{name}: {error}", file=sys.stderr)
        return 2
    texts = text_of(numbers)
    parts = {"": texts} if isinstance(texts, str) else texts
    print("\n\n".join(parts.values()))
    if page is not None and writes_page:
        text = page.read_text("utf-8")
        for name_of_part, part in parts.items():
            text = put(text, name_of_part, part)
        page.write_text(text, "utf-8")
    if path is not None:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(numbers, indent=1) + "\n", encoding="utf-8")
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
        f"{platform.python_version()}, CasADi {ca.CasadiMeta.version()}, NumPy {np.__version__}."
    )
