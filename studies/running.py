"""How studies are run, and their pages listed or confirmed."""

from __future__ import annotations

import argparse
import difflib
import sys
import tempfile
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import ModuleType

from studies.__main__ import CONFIRM, EXIT_NOT_HELD, EXIT_OK, NAMES, PROGRAM, STALE, parser_of
from studies.pages import STUDIES, Record, code_of, digest_of, numbers_of, today
from studies.session import RESULTS, Session

from iptm_core.errors import IptmError, ScenarioError
from iptm_core.program import refused

TIMES_OUT_OF_DATE = "the code has changed since these times were measured"


def answer(given: Mapping[str, argparse.Namespace]) -> int:
    """Run studies or a command with their options; returns the exit code."""
    try:
        return max(_answer(what, options) for what, options in given.items())
    except IptmError as error:
        return refused(PROGRAM, error)


def _answer(what: str, options: argparse.Namespace) -> int:
    if what == STALE:
        stale = list(stale_pages())
        print("\n".join(stale) or "no page is stale")
        return EXIT_NOT_HELD if stale else EXIT_OK
    if what == CONFIRM:
        unknown = sorted({*options.names} - {*NAMES})
        if unknown:
            raise ScenarioError(f"study is {unknown[0]!r}; allowed: {', '.join(NAMES)}")
        return max(map(confirm, options.names or NAMES), default=EXIT_OK)
    return run_study(what, options)


def module_of(name: str) -> ModuleType:
    """Return the module of a study."""
    return import_module(f"studies.{name}.run")


def run_study(name: str, options: argparse.Namespace) -> int:
    """Run a study; returns the exit code."""
    module = module_of(name)
    if options.page and (options.short or options.output):
        raise ScenarioError("--page with --short or --output; allowed: one of them")
    output = STUDIES / name if options.page else options.output or RESULTS / name
    with executor_of(options.cluster) as executor:
        session = Session(name, options, output, executor)
        held = module.run(session)
    if options.page:
        code = code_of(name)
        made = {page: digest_of(text) for page, text in session.pages.items()}
        record = Record(today(), today(), code, made, short_numbers(name))
        record.write(name)
    for run, cause in session.failures.items():
        print(f"{run}: {cause}", file=sys.stderr)
    return EXIT_OK if held and not session.failures else EXIT_NOT_HELD


@contextmanager
def executor_of(address: str | None) -> Iterator[Executor | None]:
    """Yield the executor of a cluster, None without an address.

    Raises:
        ScenarioError: the extra is not installed, or nobody answers at the address.
    """
    if address is None:
        yield None
        return
    try:
        distributed = import_module("distributed")
    except ImportError as error:
        raise ScenarioError(
            "--cluster needs dask.distributed; install requirements/cluster.txt"
        ) from error
    try:
        client = distributed.Client(address, timeout="10s")
    except OSError as error:
        raise ScenarioError(f"cluster is {address!r}: {error}") from error
    with client:
        yield client.get_executor()


def short_numbers(name: str) -> dict[str, str]:
    """Return the numbers of the short form of a study, by page; nothing where they are times of a machine."""
    module = module_of(name)
    if getattr(module, "MEASURES_TIME", False):
        return {}
    with tempfile.TemporaryDirectory() as folder:
        given = ["--short", "--no-cache", "--workers", "1", "--quiet"]
        session = Session(name, parser_of(name).parse_args(given), Path(folder))
        module.run(session)
    return {page: numbers_of(text) for page, text in session.pages.items()}


def stale_pages() -> Iterator[str]:
    """Yield a line per study whose code or data have changed since its page was made or confirmed."""
    for name in NAMES:
        record = Record.of(name)
        if record.code != code_of(name):
            why = f"; out of date: {record.out_of_date}" if record.out_of_date else ""
            yield f"{name}: made on {record.made}, confirmed on {record.confirmed}{why}"


def changes(name: str) -> list[str]:
    """Return how the numbers of the short form differ from the record, a line each, empty if they do not."""
    found, lines = short_numbers(name), []
    known = Record.of(name).short
    for page in sorted({*found, *known}):
        before, after = known.get(page, "").split(), found.get(page, "").split()
        differing = difflib.unified_diff(before, after, "recorded", "now", lineterm="", n=2)
        lines += [f"{name}/{page}: {line}" for line in differing]
    return lines


def confirm(name: str) -> int:
    """Run the short form of a study; if its numbers are as recorded, note that the page holds.

    A page with times of a machine gets a note in its foot if the code has changed since.
    """
    record, code = Record.of(name), code_of(name)
    if not record.short:
        print(f"{name}: times of a machine cannot be confirmed; make the page anew")
        if code != record.code and not record.out_of_date:
            replace(record, out_of_date=TIMES_OUT_OF_DATE).write(name)
        return EXIT_OK
    differing = changes(name)
    if differing:
        print("\n".join(differing))
        print(
            f"{name}: the short form has changed; make the page anew: scripts/study {name} --page"
        )
        return EXIT_NOT_HELD
    if code != record.code:
        replace(record, code=code, confirmed=today(), out_of_date="").write(name)
    print(f"{name}: confirmed")
    return EXIT_OK
