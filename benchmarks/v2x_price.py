"""Measures the price of not knowing the leader's future: known from a file, and from messages.

Each row drives the whole trip without ROS; the messages are real bits that are sent, lost, delayed and read.
The price is the difference in degradation between a leader that only an exact range sensor sees and one that
is known from the file; what each predictor recovers of it is counted. With --rows, finished rows are kept in
a file and not driven again; --page writes the table into docs/v2x.md.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from collections import Counter
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import formatted_table, put, run_benchmark
from benchmarks.v2x_prediction import EARLIER_DRIVES, other_drive
from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.horizon import Horizon
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_core.decision_record import Rung
from iptm_core.metrics import compute_metrics
from iptm_core.metrics.constraints import GAP_TOLERANCE_M, gap_margins_m
from iptm_core.parameters import load_parameters
from iptm_core.routes import ROUTE_CYCLES, Route, build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import run_closed_loop
from iptm_studies.safety.lead_vehicles import lead_cycles
from iptm_v2x_bridge.bridge import BridgeAnswer, CycleSource, TickBridge, V2xBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.prediction.history import History
from iptm_v2x_bridge.prediction.learnt_profile import LearntProfile
from iptm_v2x_bridge.prediction.predictor import Predictor
from iptm_v2x_bridge.prediction.received_path import ReceivedPath
from iptm_v2x_bridge.prediction.regression import Regression, RegressionModel
from iptm_v2x_bridge.radio_recording import SimulatedRadio
from iptm_v2x_bridge.sending.sender import CamSender
from iptm_v2x_bridge.sending.settings import Foresight, SenderSettings

FILE = "file"
SENSOR = "range sensor only"
DECAY = "decaying acceleration"
PATH = "path prediction"
EARLIER = "earlier drives"
REGRESSION = "regression"
LEADERS = (DECAY, PATH, EARLIER, REGRESSION)
MEASURED = ("A11", "A23", "B24", "no_ACC__handling_part22_2")
"""Lead vehicles of the excerpts of `iptm_validation` that no predictor was fitted to: three trips of an i3 on
public roads and one driver on a proving ground, of 600 s at most."""
TRIPS = ("wltc_class3b", "us06", "nycc", *MEASURED)
USUAL_ACCURACY_M = 2.8
"""Of real cars."""
CELLS = (
    (0.02, 0.0, 0.0),
    (USUAL_ACCURACY_M, 0.0, 0.0),
    (USUAL_ACCURACY_M, 0.2, 0.3),
    (USUAL_ACCURACY_M, 0.5, 1.0),
    (1.0, 0.0, 0.0),
    (8.5, 0.0, 0.0),
)
"""Accuracy in m, loss, and delay in s."""
PAGE = Path(__file__).resolve().parents[1] / "docs" / "v2x.md"


@dataclass(frozen=True)
class Case:
    """One row: the trip, how the leader is predicted, its stated accuracy and the link."""

    cycle: str
    leader: str
    accuracy_m: float = 0.0
    loss: float = 0.0
    delay_s: float = 0.0


def predictors_of(leader: str, route: Route) -> tuple[Predictor, ...]:
    """Return the predictors of a row; earlier drives are other drives of the same road."""
    if leader == PATH:
        return ReceivedPath(), History()
    if leader == REGRESSION:
        return (Regression(RegressionModel.load()),)
    if leader == EARLIER:
        source = np.random.default_rng(1)
        drives = [other_drive(route.leader, source) for _ in range(EARLIER_DRIVES)]
        return LearntProfile([(drive.positions_m, drive.speeds_m_s) for drive in drives]), History()
    return (History(),)


@lru_cache(maxsize=1)
def measured_cycles() -> dict[str, str]:
    """Return the measured lead vehicles of the project as drive files, by name."""
    folder = Path(tempfile.mkdtemp(prefix="lead_vehicles_"))
    found = lead_cycles(None, folder, lambda text: print(text, file=sys.stderr), count=1000)
    return {Path(path).stem: path for path in found}


class Watched:
    """A bridge that counts its answers."""

    def __init__(self, inner: TickBridge) -> None:
        self._inner = inner
        self.leaderless = 0
        self.predictors: Counter[str] = Counter()

    def answer(
        self, time_ns: int, host_position_m: float, host_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer of the inner bridge."""
        answer = self._inner.answer(time_ns, host_position_m, host_speed_m_s)
        self.leaderless += answer.leader is None
        self.predictors[answer.predictor or "none"] += 1
        return answer


def drive(case: Case, duration_s: float | None, seed: int) -> dict[str, Any]:
    """Drive one trip and return its figures."""
    parameters = load_parameters().values
    name = (
        case.cycle if case.cycle in ROUTE_CYCLES else measured_cycles().get(case.cycle, case.cycle)
    )
    route = build_route(name, initial_gap_m=parameters.gap.initial_gap_m, duration_s=duration_s)
    chosen = ControllerSettings()
    options = ControllerOptions(
        strategy=strategy_by_name(chosen.strategy),
        horizon=Horizon.parse(chosen.horizon),
        trip_duration_s=route.duration_s,
    )
    bridge: TickBridge
    if case.leader in {FILE, SENSOR}:
        mode = PreviewMode.FULL if case.leader == FILE else PreviewMode.NONE
        bridge = V2xBridge(CycleSource(route), PreviewSettings(preview_mode=mode))
    else:
        settings = SenderSettings(
            foresight=Foresight.PATH if case.leader == PATH else Foresight.NONE,
            position_accuracy_m=case.accuracy_m,
            link_delay_s=case.delay_s,
            loss_probability=case.loss,
            sender_seed=seed,
        )
        road = RoadLine.test_road()
        receiver = CamBridge(road, predictors=predictors_of(case.leader, route))
        bridge = SimulatedRadio(CamSender(route.leader, road, settings), receiver)
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
    cycle: tuple[str, ...] = TRIPS,
    leader: tuple[str, ...] = LEADERS,
    duration_s: float = 0.0,
    seed: int = 1,
    cells: int = len(CELLS),
    rows: str = "",
    finished: int = 0,
    page: int = 0,
) -> dict[str, Any]:
    """Measure all cases.

    Args:
        cycle: trip of the leader, a driving cycle or a measured lead vehicle; may be repeated.
        leader: how it is predicted, in addition to file and range sensor; may be repeated.
        duration_s: length of the trips, s; 0 for all of them.
        seed: of loss.
        cells: how many of the pairs of accuracy and link, the most usual ones first.
        rows: file of finished rows, which are not driven again.
        finished: 1 drives nothing and takes the finished rows only.
        page: 1 writes the table into docs/v2x.md.
    """
    cases = [Case(trip, known) for known in (FILE, SENSOR) for trip in cycle]
    cases += [Case(trip, who, *cell) for cell in CELLS[:cells] for who in leader for trip in cycle]
    store = Path(rows) if rows else None
    found: dict[Case, dict[str, Any]] = {}
    if store is not None and store.exists():
        lines = map(json.loads, store.read_text(encoding="utf-8").splitlines())
        found = {
            _case_of(row): row for row in lines if (row["for_s"], row["seed"]) == (duration_s, seed)
        }
    if finished:
        cases = [case for case in cases if case in found]
    for case in (case for case in cases if case not in found):
        row = {**drive(case, duration_s or None, seed), "for_s": duration_s, "seed": seed}
        found[case] = row
        line = json.dumps(row)
        print(line, file=sys.stderr, flush=True)
        if store is not None:
            with store.open("a", encoding="utf-8") as file:
                file.write(line + "\n")
    ordered = sorted(cases, key=lambda case: _place(case, cycle, leader))
    for case in ordered:
        plain = None if case.leader in {FILE, SENSOR} else found.get(Case(case.cycle, SENSOR))
        _compare(found[case], found[Case(case.cycle, FILE)], plain)
    numbers = {"duration_s": duration_s, "rows": [found[case] for case in ordered]}
    if page:
        text = put(PAGE.read_text(encoding="utf-8"), "price", as_table(numbers))
        PAGE.write_text(text, encoding="utf-8")
    return numbers


def _case_of(row: dict[str, Any]) -> Case:
    return Case(**{name: row[name] for name in Case.__dataclass_fields__})


def _place(case: Case, cycle: tuple[str, ...], leader: tuple[str, ...]) -> tuple[float, ...]:
    """Return the order of rows in the table."""
    who = (FILE, SENSOR, *leader).index(case.leader)
    return cycle.index(case.cycle), who, case.loss, case.accuracy_m


def _compare(row: dict[str, Any], file: dict[str, Any], plain: dict[str, Any] | None) -> None:
    """Add how a row compares with the file, and with the range sensor."""
    for key, name in (
        ("degradation_1e7", "degradation_change"),
        ("battery_energy_kj", "energy_change"),
    ):
        row[name] = 100.0 * (row[key] / file[key] - 1.0)
    row["recovered_percent"] = math.nan
    if plain is not None:
        price = plain["degradation_1e7"] - file["degradation_1e7"]
        gain = plain["degradation_1e7"] - row["degradation_1e7"]
        row["recovered_percent"] = 100.0 * gain / price


def _text(row: dict[str, Any]) -> dict[str, Any]:
    share = row["recovered_percent"]
    return {
        **row,
        "accuracy": f"{row['accuracy_m']:g} m" if row["accuracy_m"] else "-",
        "recovered": "-" if math.isnan(share) else f"{share:.0f} %",
    }


COLUMNS = {
    "trip": "{cycle}",
    "leader known from": "{leader}",
    "accuracy:": "{accuracy}",
    "lost:": "{loss_percent:.0f} %",
    "delay:": "{delay_s:g} s",
    "degradation:": "{degradation_1e7:.3f}·10⁻⁷",
    "against the file:": "{degradation_change:+.2f} %",
    "of the price recovered:": "{recovered}",
    "battery energy against the file:": "{energy_change:+.2f} %",
    "smallest gap:": "{smallest_gap_m:.2f} m",
    "smallest margin to s_min:": "{smallest_margin_m:.2f} m",
    "below s_min:": "{broken_s} s",
    "fallback:": "{fallback_ticks} ticks",
}


def as_table(numbers: dict[str, Any]) -> str:
    """Return the numbers as a table in Markdown."""
    return formatted_table(map(_text, numbers["rows"]), COLUMNS)


if __name__ == "__main__":
    sys.exit(run_benchmark(measure, text_of=as_table))
