"""Checks of statements about cell temperatures over the time of a trip."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_reproduction.check import Check, Finding, graded
from iptm_reproduction.quantities import (
    busiest_window,
    celsius,
    mean_cell_temperature_c,
    time_to_fall_s,
)
from iptm_reproduction.runs import ReportRun, Results, name_of


def settles_near(run: str, printed_c: float, tolerance_k: float, last_share: float) -> Check:
    """Check that both cells stay near a printed temperature over the last share of a trip."""

    def judge(results: Results) -> Finding:
        trip = results[run].trajectory
        rows = slice(int((1.0 - last_share) * len(trip)), None)
        start = float(celsius(trip.cell_1_temperature_k)[0])
        mean_1 = float(np.mean(celsius(trip.cell_1_temperature_k)[rows]))
        mean_n = float(np.mean(celsius(trip.cell_n_temperature_k)[rows]))
        mean = 0.5 * (mean_1 + mean_n)
        return Finding(
            graded(
                abs(mean - printed_c) <= tolerance_k,
                min(printed_c, start) <= mean <= max(printed_c, start),
            ),
            f"{mean:.2f} °C (cell 1 {mean_1:.2f}, cell N {mean_n:.2f} °C)",
            f"{printed_c:g} °C",
        )

    return Check(
        f"Mean temperature of both cells of {name_of(run)} over the last {100.0 * last_share:g} % of the "
        f"trip: reproduced within {tolerance_k:g} K of the printed value, in sign only if between that and "
        "the start.",
        (run,),
        judge,
    )


def last_cell_falls_slower(run: str, share: float) -> Check:
    """Check that the last cell cools down by a share of its fall later than the first one."""

    def judge(results: Results) -> Finding:
        trip = results[run].trajectory
        first = time_to_fall_s(trip.time_s, trip.cell_1_temperature_k, share)
        last = time_to_fall_s(trip.time_s, trip.cell_n_temperature_k, share)
        return Finding(graded(last > first), f"cell 1 {first:.0f} s, cell N {last:.0f} s")

    return Check(
        f"Reproduced if cell N of {name_of(run)} takes longer than cell 1 to fall by {100.0 * share:.0f} % "
        "of the way from its start to its lowest temperature.",
        (run,),
        judge,
    )


@dataclass(frozen=True)
class _Demand:
    """The stretch of a trip that draws most traction energy, with mean cell temperatures around it.

    Attributes:
        start_s: where it begins.
        initial_c: temperature at the start of the trip.
        before_c: temperature where the stretch begins.
        highest_c: highest temperature in the stretch.
    """

    start_s: float
    initial_c: float
    before_c: float
    highest_c: float

    @classmethod
    def of(cls, run: ReportRun, length_s: float) -> _Demand:
        window = busiest_window(run.trajectory, length_s)
        mean = mean_cell_temperature_c(run.trajectory)
        return cls(
            start_s=float(run.trajectory.time_s[window.start_row]),
            initial_c=float(mean[0]),
            before_c=float(mean[window.start_row]),
            highest_c=float(np.max(mean[window.start_row : window.end_row + 1])),
        )


def heats_in_demand(runs: tuple[str, ...], length_s: float, least_rise_k: float) -> Check:
    """Check that the pack warms up during the stretch of highest traction demand."""

    def judge(results: Results) -> Finding:
        found = {run: _Demand.of(results[run], length_s) for run in runs}
        rises = {run: demand.highest_c - demand.before_c for run, demand in found.items()}
        least = min(rises.values())
        return Finding(
            graded(least >= least_rise_k, least > 0.0),
            "; ".join(
                f"{name_of(run)}: {rises[run]:+.2f} K from {demand.start_s:.0f} s on"
                for run, demand in found.items()
            ),
        )

    return Check(
        f"In the {length_s:g} s of each run that draw most traction energy (the composition of the printed "
        "cycle is not given, so the stretch is found, not fixed), the mean of both cells rises above its "
        f"value at the start of the stretch: reproduced from {least_rise_k:g} K on in every run, in sign "
        "only if it rises at all.",
        runs,
        judge,
    )


def cooled_before_demand(runs: tuple[str, ...], length_s: float, least_drop_k: float) -> Check:
    """Check that the pack is clearly cooler at the start of the stretch of highest demand than at first."""

    def judge(results: Results) -> Finding:
        found = {run: _Demand.of(results[run], length_s) for run in runs}
        least = min(demand.initial_c - demand.before_c for demand in found.values())
        return Finding(
            graded(least >= least_drop_k, least > 0.0),
            "; ".join(
                f"{name_of(run)}: {demand.before_c:.2f} °C at {demand.start_s:.0f} s"
                for run, demand in found.items()
            ),
        )

    return Check(
        f"At the start of the {length_s:g} s that draw most traction energy, the mean of both cells is below "
        f"its initial value: reproduced from {least_drop_k:g} K on in every run, in sign only if it is lower "
        "at all.",
        runs,
        judge,
    )
