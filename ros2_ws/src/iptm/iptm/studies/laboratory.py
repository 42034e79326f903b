"""A command that drives a campaign, or finds its runs in a store, judges them and writes a page."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console

from iptm.studies.campaign import Campaign, survey
from iptm.studies.cli import EXIT_FAILED_RUNS, add_workers_option, compute, perform_command
from iptm.studies.store import ResultStore, default_store_folder
from iptm.studies.workers import worker_count

_NOT_OF_THE_PAGE = frozenset({"store", "output", "workers", "dry_run", "stored"})
"""Options that change where and when runs are computed, not what the page shows."""


class Session:
    """One call of the command.

    Attributes:
        options: the arguments.
        store: where runs are found and put.
        workers: number of processes that compute them.
        console: shows the progress.
        output: folder of the page.
        command: the call that makes the same page.
    """

    def __init__(
        self, laboratory: Laboratory, options: argparse.Namespace, console: Console
    ) -> None:
        self.options = options
        self.console = console
        self.store = ResultStore(options.store or default_store_folder() / laboratory.name)
        self.workers = worker_count(options.workers)
        self.output: Path = options.output or self.store.folder
        self.command = laboratory.command(options)
        self._page = laboratory.page

    def compute(self, campaign: Campaign) -> bool:
        """Compute what is missing of a campaign, as far as the options allow it.

        Returns:
            False if the runs were only to be shown: then the command is at its end.
        """
        if self.options.dry_run:
            for inputs in survey(campaign, self.store):
                print(f"{inputs.address:60} {inputs.spec.describe()}")
            return False
        if self.options.stored:
            survey(campaign, self.store)
        else:
            compute(campaign, self.store, self.workers, self.console)
        return True

    def write(self, text: str, page_name: str = "") -> None:
        """Write the page, or one of another name, and print its path."""
        page = self.output / (page_name or self._page)
        page.parent.mkdir(parents=True, exist_ok=True)
        page.write_text(text, encoding="utf-8")
        print(page)


class Laboratory:
    """The command line of such a command.

    Attributes:
        name: of the command, and of the folder of its results.
        page: file name of the page.
        parser: for further options.
    """

    def __init__(self, name: str, page: str, about: str | None, short: str = "") -> None:
        """Begin a command line; `short` describes the option of that name, empty for none."""
        self.name, self.page = name, page
        self.parser = argparse.ArgumentParser(prog=name, description=about)
        add = self.parser.add_argument
        if short:
            add("--short", action="store_true", help=short)
        text = "drive nothing, write the page from what is stored"
        add("--stored", action="store_true", help=text)
        add("--store", type=Path, metavar="DIR", help="folder of the results")
        text = f"folder of {page}, that of the results by default"
        add("--output", type=Path, metavar="DIR", help=text)
        add_workers_option(self.parser)
        add("--dry-run", action="store_true", help="show the runs that would be computed")

    def run(self, work: Callable[[Session], bool], arguments: Sequence[str] | None) -> int:
        """Perform the command.

        Args:
            work: drives, judges and writes; returns whether everything is as it should be.
            arguments: of the command line, those of the process for None.

        Returns:
            0 when everything is, 1 when something is not, 2 for a refusal, 128 + n after signal n.
        """

        def command(options: argparse.Namespace, console: Console) -> int:
            return os.EX_OK if work(Session(self, options, console)) else EXIT_FAILED_RUNS

        return perform_command(command, self.parser.parse_args(arguments))

    def command(self, options: argparse.Namespace) -> str:
        """Return the call that makes the same page: what differs from the defaults, folders as DIR."""
        parts = [f"scripts/{self.name}"]
        for name, value in vars(options).items():
            if name in _NOT_OF_THE_PAGE or value == self.parser.get_default(name):
                continue
            for one in value if isinstance(value, list) else [value]:
                shown = "DIR" if isinstance(one, Path) else f"{one}"
                flag = f"--{name.replace('_', '-')}"
                parts.append(flag if one is True else f"{flag} {shown}")
        return " ".join(parts)
