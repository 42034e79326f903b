"""One call of a study: what it was asked for, how it computes, and where its pages go."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd
from studies.pages import PAGE, STUDIES, put, without_foot

import iptm
from iptm_core.markdown import render_page

RESULTS = STUDIES.parent / "results"


@dataclass(frozen=True)
class Case:
    """A trip of a study.

    Attributes:
        name: unique in the study.
        labels: what varies, by name, for tables and plots.
        call: arguments of `iptm.simulate`.
    """

    name: str
    labels: Mapping[str, Any]
    call: Mapping[str, Any]

    def shortened(self, duration_s: float) -> Case:
        """Return the beginning of the trip."""
        return Case(self.name, self.labels, {**self.call, "duration_s": duration_s})


def inputs_of(call: Mapping[str, Any]) -> iptm.Trip:
    """Return the trip that `iptm.simulate` makes of its arguments.

    Raises:
        IptmError: an argument is not usable.
    """
    return iptm.Trip.of(**call).checked()


@dataclass
class Session:
    """One call of a study.

    Attributes:
        study: its name.
        options: the arguments.
        output: folder of the pages.
        executor: computes on a cluster; None for processes of this machine.
        pages: what was written, by file name.
        failures: calls that failed, name and cause.
    """

    study: str
    options: argparse.Namespace
    output: Path
    executor: Executor | None = None
    pages: dict[str, str] = field(default_factory=dict)
    failures: dict[str, str] = field(default_factory=dict)

    @property
    def short(self) -> bool:
        """Whether a little of everything was asked for."""
        return bool(self.options.short)

    @property
    def folder(self) -> Path:
        """Folder of the study."""
        return STUDIES / self.study

    @property
    def scratch(self) -> Path:
        """Folder for files that are made on the way, such as drives."""
        return RESULTS / self.study

    def say(self, text: str) -> None:
        """Report progress."""
        if not self.options.quiet:
            print(text, flush=True)

    def compute(
        self,
        function: Callable[..., Any],
        calls: Sequence[Mapping[str, Any]],
        names: Sequence[str],
        workers: int | None = None,
    ) -> list[Any]:
        """Return what a function returns for each of several sets of arguments, None where it failed.

        Finished calls are kept under ``results`` and not computed again, see `iptm.cached_calls`. With one
        of the ``workers`` it is this process, whatever the options say.
        """
        cache = None if self.options.no_cache else self.options.cache or self.scratch / "cache"
        found: list[Any] = [None] * len(calls)
        began_s = time.perf_counter()
        executor = None if workers else self.executor
        count = workers or self.options.workers
        outcomes = iptm.cached_calls(function, calls, workers=count, executor=executor, cache=cache)
        for done, outcome in enumerate(outcomes, start=1):
            name = names[outcome.index]
            if outcome.failure:
                self.failures[name] = outcome.failure
            found[outcome.index] = outcome.value
            if not outcome.cached:
                text = f"FAILED: {outcome.failure}" if outcome.failure else ""
                self.say(
                    f"[{done}/{len(calls)}] {name} {text}({time.perf_counter() - began_s:.0f} s)"
                )
        return found

    def drive(self, cases: Sequence[Case]) -> pd.DataFrame:
        """Drive cases.

        Returns:
            A row per case: its labels, ``case``, ``run`` (`iptm.Run`, None if it failed), and ``metrics``.
        """
        runs = self.compute(iptm.simulate, [case.call for case in cases], [c.name for c in cases])
        return pd.DataFrame(
            {
                **case.labels,
                "case": case.name,
                "run": run,
                "metrics": None if run is None else run.metrics,
            }
            for case, run in zip(cases, runs, strict=True)
        )

    @property
    def command(self) -> str:
        """The call that makes the same page, without folders and processes."""
        return f"scripts/study {self.study}" + (" --short" if self.short else "")

    @property
    def failure_rows(self) -> list[dict[str, str]]:
        """Failed calls as rows of a table."""
        return [{"run": name, "cause": cause} for name, cause in self.failures.items()]

    def render(self, template: str = "page.md.j2", name: str = PAGE, **values: Any) -> None:
        """Write a page from a template of the study; it has ``command`` and ``failures``, too."""
        shared = {"command": self.command, "failures": self.failure_rows}
        self.write(render_page(self.folder, template, **shared, **values), name)

    def fill(self, parts: Mapping[str, str], name: str = PAGE) -> None:
        """Put texts between their marks in a page that is written by hand around them."""
        page = self.pages.get(name) or (self.folder / name).read_text("utf-8")
        if self.short:
            page = "\n\n".join(f"<!-- {part} -->\n<!-- end of {part} -->" for part in parts)
        for part, text in parts.items():
            page = put(page, part, text)
        self.write(page, name)

    def write(self, page: str, name: str = PAGE) -> None:
        """Write a page as it is."""
        self.pages[name] = without_foot(page)
        path = self.output / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(self.pages[name], "utf-8")
        self.say(str(path))
