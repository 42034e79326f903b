"""One headline: every output names the saving that a computation from the rows alone gives."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import iptm
from iptm.run import figure_title
from iptm.runner.summary import headline
from iptm.sweeping import Sweep
from iptm.trip_files import load_trip
from iptm_core.metrics.figures import SAVINGS
from iptm_core.metrics.saved_share import Basis
from iptm_core.parameters import to_flat_dict
from iptm_string.report import string_parts

GPX = Path(__file__).parents[2] / "docs" / "examples" / "phone_drive.gpx"
FLAT = (np.arange(121.0), np.full(121, 50.0 / 3.6))
TRIPS: dict[str, Callable[[], iptm.Trip]] = {
    "flat road": lambda: iptm.Trip.of(FLAT),
    "phone": lambda: iptm.Trip.of(str(GPX)),
    "demo": lambda: load_trip("demo"),
    "us06": lambda: iptm.Trip.of("us06"),
    "wltc": lambda: load_trip("wltc"),
}
LONG = {"us06", "wltc"}
KINDS = ("aging", "energy")
TOLERANCE_POINTS = 0.1


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=pytest.mark.slow if name in LONG else ()) for name in TRIPS],
)
def runs(request: Any) -> tuple[iptm.Run, iptm.Run]:
    trip = TRIPS[request.param]()
    own, other = iptm.drive(trip), iptm.drive(trip.against("reference"))
    return replace(own, other=other), other


def by_hand(run: iptm.Run, end_k: float) -> np.ndarray:
    """Return capacity loss and energy per metre as driven and with the pack cooled to a temperature, (2, 2).

    Only the rows of the trip, the parameters by name and the paper's equations.
    """
    rows, p = run.frame, to_flat_dict(run.parameters)
    last, step_s = rows.iloc[-1], np.diff(rows.index)
    losses = last[["cell_1_capacity_loss", "cell_n_capacity_loss"]].to_numpy(float)
    lost = losses.sum() - rows[["cell_1_capacity_loss", "cell_n_capacity_loss"]].iloc[0].sum()
    energy_j = float(rows.battery_power_w.to_numpy()[1:] @ step_s)
    distance_m = float(np.ptp(rows.position_m))
    motion_j = 0.5 * p["body.rotational_inertia_factor"] * p["body.mass_kg"] * last.speed_m_s**2
    warm_k = 0.5 * (last.cell_1_temperature_k + last.cell_n_temperature_k)
    cooling_j = aged = 0.0
    if warm_k > end_k:
        cooling_j, aged = _cooled(p, warm_k, end_k, losses)
    ended = [lost + aged, (energy_j + cooling_j - motion_j) / distance_m]
    return np.array([[lost, energy_j / distance_m], ended])


def _cooled(
    p: dict[str, float], warm_k: float, end_k: float, losses: np.ndarray
) -> tuple[float, float]:
    """Return energy (J) and capacity loss of cooling the pack at standstill, at the best power."""
    t_k, celsius = 0.5 * (warm_k + end_k), 0.5 * (warm_k + end_k) - 273.15
    vertex_w = -p["chiller.xi_1"] / (2.0 * p["chiller.xi_2_1_w"])
    power_w = np.arange(10.0, min(vertex_w, p["limits.max_compressor_power_w"]) + 1e-6, 10.0)
    # Eq. (14), gated; the coolant leaves the channel nearer to the cells by the factor `kept`.
    air_kg_s = p["chiller.air_flow_at_rest_kg_s"]
    ambient_c = p["environment.ambient_temperature_k"] - 273.15
    offset_w = p["chiller.xi_1"] * power_w + p["chiller.xi_2_1_w"] * power_w**2
    offset_w = offset_w + p["chiller.xi_4_j_kg_k"] * ambient_c * air_kg_s + p["chiller.xi_6_w"]
    flow_kg_s = p["cooling.coolant_mass_flow_kg_s"]
    slope_w_k = p["chiller.xi_3_w_k"] + p["chiller.xi_5_j_kg_k"] * flow_kg_s
    gate = 1.0 - np.exp(-((power_w / p["chiller.gate_power_w"]) ** 2))
    flow_w_k = p["cooling.coolant_specific_heat_j_kg_k"] * flow_kg_s
    ratio = p["cooling.convective_coefficient_w_k"] * p["pack.modules"] / flow_w_k
    kept = (1.0 - ratio) ** p["pack.cells_per_channel"]
    behind_k_w = kept / (flow_w_k * (1.0 - kept))
    taken_w = gate * (offset_w + slope_w_k * celsius) / (1.0 + gate * slope_w_k * behind_k_w)
    # Eqs. (4), (7), (13): the current of compressor and auxiliaries.
    drawn_w = (power_w + p["cooling.auxiliary_power_w"]) / p["pack.battery_efficiency"]
    series = p["pack.modules"] * p["pack.series_per_module"]
    thermal = 1.0 + p["cell.resistance_temperature_coefficient_1_k"] * (
        t_k - p["cell.nominal_temperature_k"]
    )
    fresh = (1.0 - losses) ** -p["cell.resistance_aging_exponent"]
    ohm = p["cell.nominal_resistance_ohm"] * thermal * p["cell.resistance_aging_factor"] * fresh
    volt = p["pack.open_circuit_voltage_v"] - series * p["cell.entropic_coefficient_v_k"] * t_k
    pack_ohm = ohm.mean() * series / p["pack.parallel"]
    amp = (volt - np.sqrt(volt**2 - 4.0 * pack_ohm * drawn_w)) / (2.0 * pack_ohm)
    amp = amp / p["pack.parallel"]
    cells = series * p["pack.parallel"]
    made_w = cells * (ohm.mean() * amp**2 + amp * p["cell.entropic_coefficient_v_k"] * t_k)
    net_w = np.where(taken_w > made_w, taken_w - made_w, np.nan)
    lasts_s = cells * p["cell.heat_capacity_j_k"] * (warm_k - end_k) / net_w
    # Eq. (12) of both cells.
    z, c_rate = p["aging.throughput_exponent"], amp / p["cell.nominal_capacity_ah"]
    stress = p["aging.compensation_factor_j_mol"] * c_rate - p["aging.activation_energy_j_mol"]
    per_s = z * p["aging.pre_exponential_factor"] ** (1.0 / z) * amp / 3600.0
    per_s = per_s * np.exp(stress / (p["aging.gas_constant_j_mol_k"] * t_k * z))
    best = int(np.nanargmin(drawn_w * lasts_s))
    aged = (losses ** (1.0 - 1.0 / z)).sum() * per_s[best] * lasts_s[best]
    return float(drawn_w[best] * lasts_s[best]), float(aged)


def saved_by_hand(own: iptm.Run, other: iptm.Run) -> pd.DataFrame:
    ends_k = [
        run.frame[["cell_1_temperature_k", "cell_n_temperature_k"]].iloc[-1].mean()
        for run in (own, other)
    ]
    figures = [by_hand(run, min(ends_k)) for run in (own, other)]
    saved = 100.0 * (1.0 - figures[0] / figures[1])
    return pd.DataFrame(saved.T, KINDS, ["driven", "equal"])


def shown(own: iptm.Run, other: iptm.Run, folder: Path) -> Iterator[tuple[str, str]]:
    """Yield name and text of every output."""
    yield "terminal", "\n".join(text for _, text in headline(own).lines)
    yield "library", own.saving(other).headline
    yield "comparison", "\n".join(iptm.compare(other, own).headlines)
    yield "report", own.report(folder / "report.html").read_text(encoding="utf-8")
    yield "picture", own.plot(other).get_suptitle()
    yield (
        "string",
        str(
            string_parts([own], [other])[1].rows[["energy_saved", "cells", "aging_saved"]].to_dict()
        ),
    )
    if find_spec("iptm_view") is not None:
        page = import_module("tests.extras.iptm_view.judged_page")
        yield "view", page.last_savings(own, other)
    yield "explain", own.explain(other).sentence


def test_every_output_has_the_headline_of_the_rows(
    runs: tuple[iptm.Run, iptm.Run], tmp_path: Path
) -> None:
    own, other = runs
    expected, saving = saved_by_hand(own, other), own.saving(other)
    is_short = own.frame.index[-1] < 1800.0
    by_ends = [
        not is_short and abs(expected.equal[kind] - expected.driven[kind]) <= 5.0 for kind in KINDS
    ]
    shares = saving.aging, saving.energy
    for kind, is_by_ends, share in zip(KINDS, by_ends, shares, strict=True):
        near = pytest.approx(expected.equal[kind], abs=TOLERANCE_POINTS)
        assert share.equal_ends_percent == near
        assert share.as_driven_percent == pytest.approx(expected.driven[kind], abs=0.01)
        assert (share.basis is Basis.EQUAL_ENDS) is is_by_ends
        assert share.percent == near or share.basis is Basis.REPEATED
    for name, text in shown(own, other, tmp_path):
        for share in (saving.energy, saving.cells, saving.aging):
            assert share.text in text.lower(), (name, share.text)
    numbers = [
        own.summary[: len(SAVINGS)],
        Sweep(({"strategy": "reference"}, {"strategy": "own"}), (other, own))
        .savings(strategy="reference")
        .iloc[1],
        iptm.compare(reference=other, own=own).table["own"],
    ]
    for found in numbers:
        for kind, share in zip(KINDS, shares, strict=True):
            assert float(found[figure_title(f"{kind}_saved")]) == share.percent
