"""Verdicts on disk, so that a table can be made in several runs of the command."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from iptm_bringup.fault_table.catalogue import DriveMode, Entry
from iptm_bringup.fault_table.judge import TrialOutcome
from iptm_core.errors import StoreError
from iptm_interfaces.diagnostics import Level


class VerdictStore:
    """Folder of verdicts; a new verdict replaces the old one of the same fault, mode and cycle."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "verdicts.json"

    def load(self, entries: Sequence[Entry]) -> list[TrialOutcome]:
        """Return the verdicts on the rows of a table; those on other rows are left out.

        Raises:
            StoreError: the file is not a verdict file.
        """
        if not self._file.is_file():
            return []
        by_name = {entry.name: entry for entry in entries}
        try:
            written = json.loads(self._file.read_text(encoding="utf-8"))
            return [
                _verdict(by_name[one["fault"]], one) for one in written if one["fault"] in by_name
            ]
        except (KeyError, TypeError, ValueError) as error:
            raise StoreError(
                f"{self._file} cannot be read ({type(error).__name__}: {error}); allowed: verdicts of "
                "scripts/faults, or no such file"
            ) from None

    def add(self, entries: Sequence[Entry], verdicts: Sequence[TrialOutcome]) -> None:
        """Keep verdicts."""
        kept = {_key(one): one for one in (*self.load(entries), *verdicts)}
        content = [
            {
                "fault": one.entry.name,
                "mode": one.mode.value,
                "cycle": one.cycle,
                "reasons": one.reasons,
                "level": one.level.name,
                "changes": one.changes,
                "normal_after": _plain(one.normal_after),
                "smallest_gap_m": _plain(one.smallest_gap_m),
                "braking_gap_m": _plain(one.braking_gap_m),
                "problems": one.problems,
            }
            for one in kept.values()
        ]
        self._file.parent.mkdir(parents=True, exist_ok=True)
        self._file.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def failed(entry: Entry, mode: DriveMode, cycle: str, why: str) -> TrialOutcome:
    """Return the verdict on a fault whose trip failed."""
    return replace(TrialOutcome(entry, mode, cycle), problems=(why,))


def _key(verdict: TrialOutcome) -> tuple[str, DriveMode, str]:
    return verdict.entry.name, verdict.mode, verdict.cycle


def _verdict(entry: Entry, written: Mapping[str, Any]) -> TrialOutcome:
    return TrialOutcome(
        entry,
        DriveMode(written["mode"]),
        written["cycle"],
        tuple(written["reasons"]),
        Level[written["level"]],
        written["changes"],
        _number(written["normal_after"]),
        _number(written["smallest_gap_m"]),
        _number(written["braking_gap_m"]),
        tuple(written["problems"]),
    )


def _plain(number: float) -> float | None:
    return number if math.isfinite(number) else None


def _number(written: float | None) -> float:
    return math.nan if written is None else written
