"""The data of a page with what the run has saved so far, judged as for every other output."""

from __future__ import annotations

import json
import math
import threading
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from iptm_core.aging_laws.judging import Exposure, losses_of_cells
from iptm_core.errors import StateError
from iptm_core.metrics.following import Following
from iptm_core.metrics.repeated import Repeated
from iptm_core.metrics.saved_share import SavedShare
from iptm_core.metrics.saving import judge_saving
from iptm_core.parameters import ModelParameters
from iptm_core.state import NS_PER_S
from iptm_core.units import CELSIUS_ZERO_K
from iptm_view.page_feed import END, REFERENCE, ROWS, SAVINGS, PageFeed
from iptm_view.page_row import PAGE_COLUMNS
from iptm_view.reference_car import STATE

EVERY_S = 10.0
"""Trip time between two savings on the page; the last instant has one, too."""


@dataclass(frozen=True)
class SoFar:
    """Figures of a trip up to a row, as `iptm_core.metrics.judge_saving` needs them."""

    duration_s: float
    distance_m: float
    battery_energy_j: float
    degradation: float
    hard_violations: int
    final_speed_m_s: float
    final_temperature_k: float
    final_cell_losses: tuple[float, float]
    final_charge: float
    moving_mass_kg: float = 0.0
    following: Following = field(default_factory=Following)
    cell_losses: Mapping[str, float] = field(default_factory=dict)
    unbalanced_heat_share: float = math.nan

    @property
    def final_kinetic_energy_j(self) -> float:
        """Energy of the motion, rotating parts included."""
        return 0.5 * self.moving_mass_kg * self.final_speed_m_s**2


@dataclass
class _Rows:
    """Figures up to each row of a car, by stamp."""

    columns: Sequence[str]
    so_far: dict[int, SoFar] = field(default_factory=dict)
    _columns: dict[str, list[float]] = field(default_factory=dict)
    _first: dict[str, float] = field(default_factory=dict)
    _last: dict[str, float] = field(default_factory=dict)

    def take(self, row: Sequence[float | None]) -> None:
        known = dict.fromkeys(_NEEDED, math.nan)
        known |= {
            name: value
            for name, value in zip(self.columns, row, strict=True)
            if name in known and value is not None
        }
        before = next(reversed(self.so_far.values()), None)
        first = self._first or known
        losses = known["cell_1_capacity_loss"], known["cell_n_capacity_loss"]
        step_s = known["time_s"] - self._last.get("time_s", known["time_s"])
        energy_j = known["battery_power_w"] * step_s if step_s > 0.0 else 0.0
        broken = known["gap_m"] <= 0.0 or not _is_possible(known["state_of_charge"])
        celsius = known["cell_1_temperature_c"], known["cell_n_temperature_c"]
        self.so_far[_stamp_ns(known["time_s"])] = SoFar(
            duration_s=known["time_s"] - first["time_s"],
            distance_m=known["position_m"] - first["position_m"],
            battery_energy_j=energy_j + (before.battery_energy_j if before else 0.0),
            degradation=sum(losses) - first["cell_1_capacity_loss"] - first["cell_n_capacity_loss"],
            hard_violations=int(broken) + (before.hard_violations if before else 0),
            final_speed_m_s=known["speed_m_s"],
            final_temperature_k=0.5 * sum(celsius) + CELSIUS_ZERO_K,
            final_cell_losses=losses,
            final_charge=known["state_of_charge"],
        )
        self._first, self._last = first, known
        for name in _OVER_TIME:
            self._columns.setdefault(name, []).append(known[name])

    def up_to(self, stamp_ns: int, moving_mass_kg: float) -> SoFar:
        """Return the figures up to a row, with how the car followed and what the measured cells lost."""
        count = bisect_right(self._columns["time_s"], (stamp_ns + 1) / NS_PER_S)
        time_s, speed_m_s, gap_m, least_m, charge, first_c, last_c = (
            np.array(self._columns[name][:count]) for name in _OVER_TIME
        )
        try:
            mean_k = 0.5 * (first_c + last_c) + CELSIUS_ZERO_K
            lost = losses_of_cells(Exposure(time_s, charge, mean_k))
        except StateError:
            lost = {}
        return replace(
            self.so_far[stamp_ns],
            moving_mass_kg=moving_mass_kg,
            following=Following.of(time_s, speed_m_s, gap_m, gap_m - least_m),
            cell_losses=lost,
        )


_OVER_TIME = (
    "time_s",
    "speed_m_s",
    "gap_m",
    "min_gap_m",
    "state_of_charge",
    "cell_1_temperature_c",
    "cell_n_temperature_c",
)
"""Columns of which every row counts."""
_NEEDED = (
    *_OVER_TIME,
    "position_m",
    "battery_power_w",
    "cell_1_capacity_loss",
    "cell_n_capacity_loss",
)


class JudgedFeed(PageFeed):
    """A feed that appends the savings of the run against the reference car, computed from the rows of both.

    Attributes:
        parameters: of the vehicle; None as long as they are not known, without which nothing is judged.
    """

    def __init__(self) -> None:
        super().__init__()
        self.parameters: ModelParameters | None = None
        self._rows = {ROWS: _Rows(tuple(PAGE_COLUMNS)), REFERENCE: _Rows(())}
        self._judged_ns = -1
        self._has_ended = False
        self._repeated: tuple[Repeated, Repeated] | None = None
        self._judging = threading.RLock()

    def append_text(self, stream: str, text: str) -> None:
        """Append an entry that is JSON text already."""
        super().append_text(stream, text)
        if stream in self._rows:
            with self._judging:
                self._rows[stream].take(json.loads(text))
                self._judge()

    def put(self, kind: str, document: Mapping[str, Any]) -> None:
        """Replace the document of a kind; an unchanged one is not sent again."""
        super().put(kind, document)
        with self._judging:
            if kind == STATE and tuple(document["columns"]) != self._rows[REFERENCE].columns:
                self._rows[REFERENCE] = _Rows(tuple(document["columns"]))
            if kind == STATE and document.get("repeated"):
                own, other = (Repeated(**each) for each in document["repeated"])
                self._repeated = own, other
                self._judged_ns -= 1  # what was judged last is judged again
            if kind == END:
                self._has_ended = bool(document["ended"])
            self._judge()

    def discard(self, *kinds: str) -> None:
        """Discard streams and documents; every browser receives all the others again."""
        with self._judging:
            for stream, rows in self._rows.items():
                if stream in kinds:
                    self._rows[stream] = _Rows(rows.columns)
            self._judged_ns, self._has_ended = -1, False
            self._repeated = None if REFERENCE in kinds else self._repeated
        super().discard(*kinds, SAVINGS)

    def _judge(self) -> None:
        own, other = (self._rows[stream].so_far for stream in (ROWS, REFERENCE))
        if not own or not other or self.parameters is None:
            return
        last_ns = next(reversed(own))
        newest_ns = min(last_ns, next(reversed(other)))
        due_ns = self._judged_ns + round(EVERY_S * NS_PER_S) if self._judged_ns >= 0 else 1
        stamps = (last_ns,) if newest_ns < due_ns else own
        for stamp_ns in stamps:
            is_end = self._has_ended and stamp_ns == last_ns
            is_due = stamp_ns >= due_ns or (is_end and stamp_ns > self._judged_ns)
            if is_due and stamp_ns <= newest_ns and stamp_ns in other:
                self._show(stamp_ns, self.parameters, self._repeated if is_end else None)
                self._judged_ns = stamp_ns
                due_ns = stamp_ns + round(EVERY_S * NS_PER_S)

    def _show(
        self,
        stamp_ns: int,
        parameters: ModelParameters,
        repeated: tuple[Repeated, Repeated] | None,
    ) -> None:
        body = parameters.body
        mass_kg = body.rotational_inertia_factor * body.mass_kg
        own, other = (self._rows[stream].up_to(stamp_ns, mass_kg) for stream in (ROWS, REFERENCE))
        found = judge_saving(own, other, parameters, repeat=lambda: repeated)
        entry = {
            "time_s": stamp_ns / NS_PER_S,
            "energy": _shown(found.energy),
            "others": "; ".join(f"{label}: {text}" for label, text in found.lines[1:]),
        }
        super().append_text(SAVINGS, json.dumps(entry))


def _shown(share: SavedShare) -> dict[str, Any]:
    percent = share.percent if math.isfinite(share.percent) else None
    return {"percent": percent, "text": share.text, "as_driven": share.as_driven}


def _is_possible(charge: float) -> bool:
    return math.isnan(charge) or 0.0 <= charge <= 1.0


def _stamp_ns(time_s: float) -> int:
    return round(time_s * NS_PER_S)
