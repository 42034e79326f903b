"""Measures the price of not knowing the leader's future: known from a file, and from messages.

Each row drives the whole trip without ROS; the messages are real bits that are sent, lost, delayed and read.
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.harness import formatted_table, run_benchmark
from iptm_controller.controller import Controller, ControllerOptions
from iptm_controller.decision import Decision
from iptm_controller.horizon import Horizon
from iptm_controller.measurements import Measurements
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_core.decision_record import Rung
from iptm_core.metrics import compute_metrics
from iptm_core.metrics.constraints import GAP_TOLERANCE_M, gap_margins_m
from iptm_core.parameters import load_parameters
from iptm_core.routes import build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import PreviewSettings
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import run_closed_loop
from iptm_v2x_bridge.bridge import BridgeAnswer, TickBridge, V2xBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.sending.sender import CamSender
from iptm_v2x_bridge.sending.settings import Foresight, SenderSettings
from iptm_v2x_bridge.simulated_radio import SimulatedRadio
from iptm_v2x_bridge.source import CycleSource

LOSSES = (0.0, 0.2, 0.5)
DELAYS_S = (0.0, 0.3, 1.0)
SENDERS = {
    "path prediction, 10 Hz": (Foresight.PATH, 10.0),
    "plain, 10 Hz": (Foresight.NONE, 10.0),
    "plain, 1 Hz": (Foresight.NONE, 1.0),
}
FILE = "file"


@dataclass(frozen=True)
class Case:
    """One row: who tells of the leader, and what the link makes of it."""

    leader: str
    loss: float = 0.0
    delay_s: float = 0.0


class Watched:
    """A bridge that counts what it said."""

    def __init__(self, inner: TickBridge) -> None:
        self._inner = inner
        self.leaderless = 0
        self.predictors: Counter[str] = Counter()

    def answer(self, time_ns: int, host_position_m: float) -> BridgeAnswer:
        """Return the answer of the inner bridge."""
        answer = self._inner.answer(time_ns, host_position_m)
        self.leaderless += answer.leader is None
        self.predictors[answer.predictor or "none"] += 1
        return answer


def drive(case: Case, cycle: str, duration_s: float | None, seed: int) -> dict[str, Any]:
    """Drive one trip and return its figures."""
    parameters = load_parameters().values
    route = build_route(cycle, initial_gap_m=parameters.gap.initial_gap_m, duration_s=duration_s)
    chosen = ControllerSettings()
    options = ControllerOptions(
        strategy=strategy_by_name(chosen.strategy),
        horizon=Horizon.parse(chosen.horizon),
        trip_duration_s=route.duration_s,
    )
    bridge: TickBridge
    if case.leader == FILE:
        faults = PreviewSettings(latency_s=case.delay_s, dropout_probability=case.loss, seed=seed)
        bridge = V2xBridge(CycleSource(route), faults)
    else:
        foresight, rate_hz = SENDERS[case.leader]
        settings = SenderSettings(
            rate_hz=rate_hz,
            foresight=foresight,
            link_delay_s=case.delay_s,
            loss_probability=case.loss,
            sender_seed=seed,
        )
        road = RoadLine.test_road()
        bridge = SimulatedRadio(CamSender(route.leader, road, settings), CamBridge(road))
    watched = Watched(bridge)
    safe_law: list[int] = []

    def on_tick(tick: int, _: Measurements, decision: Decision) -> None:
        if decision.record.rung is not Rung.OPTIMAL:
            safe_law.append(tick)

    controller = Controller(parameters, options)
    plant = Plant(parameters, route.slope.slope_at)
    loop = run_closed_loop(route, plant, controller, on_tick=on_tick, bridge=watched)
    run = compute_metrics(loop.trajectory, parameters, loop.decisions)
    margins = gap_margins_m(loop.trajectory, parameters)
    broken = margins < -GAP_TOLERANCE_M
    return {
        **asdict(case),
        "loss_percent": 100.0 * case.loss,
        "degradation_1e7": 1e7 * run.degradation.total,
        "battery_energy_kj": 1e-3 * run.energy.battery_j,
        "smallest_gap_m": run.gap.smallest_m,
        "smallest_margin_m": run.gap.smallest_margin_m,
        "mean_gap_m": run.gap.mean_m,
        "broken_s": int(np.count_nonzero(broken)),
        "fallback_ticks": len(safe_law),
        "leaderless_ticks": watched.leaderless,
        "predictors": dict(watched.predictors),
        "hardest_braking_m_s2": float(-loop.trajectory.acceleration_m_s2.min()),
    }


def measure(
    cycle: str = "wltc_class3b",
    duration_s: float = 0.0,
    seed: int = 1,
    quick: int = 0,
    leader: tuple[str, ...] = tuple(SENDERS),
) -> dict[str, Any]:
    """Measure all cases.

    Args:
        cycle: driving cycle of the leader.
        duration_s: length of the trip, s; 0 for all of it.
        seed: of loss.
        leader: known from the file, and from these messages; may be repeated.
        quick: 1 takes only the best and the worst link.
    """
    links = [(loss, delay_s) for loss in LOSSES for delay_s in DELAYS_S]
    if quick:
        links = [links[0], links[-1]]
    cases = [Case(FILE)] + [Case(sender, *link) for sender in leader for link in links]
    rows = []
    for case in cases:
        rows.append(drive(case, cycle, duration_s or None, seed))
        first = rows[0]
        for key, name in (
            ("degradation_1e7", "degradation_change"),
            ("battery_energy_kj", "energy_change"),
        ):
            rows[-1][name] = 100.0 * (rows[-1][key] / first[key] - 1.0)
        print(rows[-1], file=sys.stderr, flush=True)
    return {"cycle": cycle, "duration_s": duration_s, "rows": rows}


COLUMNS = {
    "leader known from": "{leader}",
    "lost:": "{loss_percent:.0f} %",
    "delay:": "{delay_s:g} s",
    "degradation:": "{degradation_1e7:.3f}·10⁻⁷",
    "against the file:": "{degradation_change:+.2f} %",
    "battery energy:": "{battery_energy_kj:.0f} kJ",
    "against the file :": "{energy_change:+.2f} %",
    "smallest gap:": "{smallest_gap_m:.2f} m",
    "smallest margin to s_min:": "{smallest_margin_m:.2f} m",
    "mean gap:": "{mean_gap_m:.1f} m",
    "below s_min:": "{broken_s} s",
    "no leader:": "{leaderless_ticks} ticks",
    "fallback:": "{fallback_ticks} ticks",
}


def as_table(numbers: dict[str, Any]) -> str:
    """Return the numbers as a table in Markdown."""
    return formatted_table(numbers["rows"], COLUMNS)


if __name__ == "__main__":
    sys.exit(run_benchmark(measure, text_of=as_table))
