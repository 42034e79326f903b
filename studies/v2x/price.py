"""Measures the price of not knowing the leader's future: known from a file, and from messages.

Each row drives the whole trip without ROS; the messages are real bits that are sent, lost, delayed and read.
The price is the difference in degradation between a leader that only an exact range sensor sees and one that
is known from the file; what each predictor recovers of it is counted.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from studies.measured_cycles import lead_cycles
from studies.savings import PREVIEWS, road_taken
from studies.v2x.prediction import EARLIER_DRIVES, other_drive

from iptm.closed_loop import run_closed_loop
from iptm_controller.controller import MpcController
from iptm_controller.horizon import Horizon
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_core.decision_record import Rung
from iptm_core.markdown import markdown_table
from iptm_core.metrics.constraints import GAP_TOLERANCE_M, gap_margins_m
from iptm_core.metrics.run_metrics import compute_metrics
from iptm_core.parameters import load_parameters
from iptm_core.routes import Route, build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_plant_sim.plant import Plant
from iptm_v2x_bridge.bridge import CycleSource, TickBridge, V2xBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.prediction.expected_motion import History, LearntProfile
from iptm_v2x_bridge.prediction.predictor import LeaderPredictor, ReceivedPath
from iptm_v2x_bridge.prediction.regression import GAIN_FACTOR, Regression, RegressionModel
from iptm_v2x_bridge.radio_recording import SimulatedRadio
from iptm_v2x_bridge.sender import CamSender
from iptm_v2x_bridge.settings import Foresight, SenderSettings

FILE, SENSOR = "file", "range sensor only"
DECAY, PATH = "decaying acceleration", "path prediction"
EARLIER, REGRESSION = "earlier drives", "regression"
LEADERS = (DECAY, PATH, EARLIER, REGRESSION)
PREVIEW_OF = {FILE: PREVIEWS[True], SENSOR: PREVIEWS[False], PATH: "60 s, received"}
"""What the controller is given of the leader's future; everything else is ``60 s, predicted``."""
MEASURED = ("A11", "A23", "B24", "no_ACC__handling_part22_2")
"""Lead vehicles of the excerpts of the validation that no predictor was fitted to: three trips of an i3 on
public roads and one driver on a proving ground, of 600 s at most."""
TRIPS = ("wltc_class3b", "us06", "nycc", *MEASURED)
CELLS = (
    (0.02, 0.0, 0.0),
    (2.8, 0.0, 0.0),
    (2.8, 0.2, 0.3),
    (2.8, 0.5, 1.0),
    (1.0, 0.0, 0.0),
    (8.5, 0.0, 0.0),
    (2.8, 0.2, 0.0),
    (2.8, 0.5, 0.0),
)
"""Accuracy in m, loss, and delay in s; real cars state 2.8 m and more."""
GAINS = ", gains times "
"""A leader "regression, gains times 1.7" is predicted with that factor in place of `GAIN_FACTOR`."""
KEY = ["cycle", "leader", "accuracy_m", "loss", "delay_s"]


def predictors_of(leader: str, route: Route) -> tuple[LeaderPredictor, ...]:
    """Return the predictors of a row; earlier drives are other drives of the same road."""
    if leader == PATH:
        return ReceivedPath(), History()
    name, _, factor = leader.partition(GAINS)
    if name == REGRESSION:
        return (Regression(RegressionModel.load(), float(factor or GAIN_FACTOR)),)
    if leader == EARLIER:
        source = np.random.default_rng(1)
        drives = [other_drive(route.leader, source) for _ in range(EARLIER_DRIVES)]
        return LearntProfile([(drive.positions_m, drive.speeds_m_s) for drive in drives]), History()
    return (History(),)


def measured_cycles(folder: Path) -> dict[str, str]:
    """Write the measured lead vehicles of the excerpts as drive files; returns their paths by name."""
    return {Path(path).stem: path for path in lead_cycles(folder, count=1000)}


def drive(
    cycle: str,
    leader: str,
    accuracy_m: float = 0.0,
    loss: float = 0.0,
    delay_s: float = 0.0,
    duration_s: float | None = None,
    seed: int = 1,
    file: str = "",
) -> dict[str, Any]:
    """Drive one trip and return its figures; ``file`` is the drive of a cycle that is not shipped."""
    parameters = load_parameters().values
    route = build_route(
        file or cycle, initial_gap_m=parameters.gap.initial_gap_m, duration_s=duration_s
    )
    chosen = ControllerSettings()
    options = ControllerOptions(
        strategy=strategy_by_name(chosen.strategy),
        horizon=Horizon.parse(chosen.horizon),
        trip_duration_s=route.duration_s,
    )
    bridge: TickBridge
    if leader in {FILE, SENSOR}:
        mode = PreviewMode.FULL if leader == FILE else PreviewMode.NONE
        bridge = V2xBridge(CycleSource(route), PreviewSettings(preview_mode=mode))
    else:
        settings = SenderSettings(
            foresight=Foresight.PATH if leader == PATH else Foresight.NONE,
            position_accuracy_m=accuracy_m,
            link_delay_s=delay_s,
            loss_probability=loss,
            sender_seed=seed,
        )
        road = RoadLine.test_road()
        receiver = CamBridge(road, predictors=predictors_of(leader, route))
        bridge = SimulatedRadio(CamSender(route.leader, road, settings), receiver)
    plant = Plant(parameters, route.slope.slope_at)
    loop = run_closed_loop(route, plant, MpcController(parameters, options), bridge=bridge)
    run = compute_metrics(loop.trajectory, parameters, loop.decisions)
    beyond_m = loop.trajectory.gap_m - parameters.gap.max_gap_m
    broken = gap_margins_m(loop.trajectory, parameters) < -GAP_TOLERANCE_M
    return {
        **dict(zip(KEY, (cycle, leader, accuracy_m, loss, delay_s), strict=True)),
        "preview": PREVIEW_OF.get(leader, "60 s, predicted"),
        "mean_headway_s": road_taken([loop.trajectory])["mean_headway_s"],
        "degradation_1e7": 1e7 * run.degradation,
        "battery_energy_kj": 1e-3 * run.battery_energy_j,
        "smallest_gap_m": run.smallest_gap_m,
        "smallest_margin_m": run.smallest_margin_m,
        "above_s_max_s": int(np.count_nonzero(beyond_m > GAP_TOLERANCE_M)),
        "above_s_max_m": max(float(beyond_m.max()), 0.0),
        "broken_s": int(np.count_nonzero(broken)),
        "fallback_ticks": int(np.count_nonzero(np.asarray(loop.decisions.rung) != Rung.OPTIMAL)),
    }


def cases_of(
    cycles: Sequence[str], leaders: Sequence[str] = LEADERS, cells: int | None = None
) -> list[tuple[Any, ...]]:
    """Return what is driven, in the order of `KEY`: the first ``cells`` pairs of accuracy and link."""
    cases = [(trip, known, 0.0, 0.0, 0.0) for known in (FILE, SENSOR) for trip in cycles]
    return cases + [
        (trip, who, *cell) for cell in CELLS[:cells] for who in leaders for trip in cycles
    ]


def with_prices(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Add the price of not knowing to rows: ``degradation_change`` and ``recovered_percent``."""
    found = {tuple(row[name] for name in KEY): row for row in rows}
    for case, row in found.items():
        exact, plain = (found[case[0], known, 0.0, 0.0, 0.0] for known in (FILE, SENSOR))
        ageing, least, most = (each["degradation_1e7"] for each in (row, exact, plain))
        row["degradation_change"] = 100.0 * (ageing / least - 1.0)
        row["recovered_percent"] = 100.0 * (most - ageing) / (most - least)
    return list(rows)


def as_table(rows: list[dict[str, Any]]) -> dict[str, str]:
    """Return the rows as a table in Markdown: trips and leaders by accuracy and link."""
    frame = pd.DataFrame(rows)
    change, share = "{degradation_change:+.1f} %", "{recovered_percent:.0f} %"
    cell = f"{change}, {share}, {{smallest_margin_m:.2f}} m".format
    frame["cell"] = [cell(**row) for row in rows]
    frame["headway"] = frame["mean_headway_s"].map("{:.1f} s".format)
    frame["link"] = [
        f"{row['accuracy_m']:g} m"
        + (f", {row['loss']:.0%} lost" if row["loss"] else "")
        + (f", {row['delay_s']:g} s late" if row["delay_s"] else "")
        for row in rows
    ]
    radio = ~frame["leader"].isin([FILE, SENSOR])
    links = frame[radio].sort_values(["delay_s", "loss", "accuracy_m"])["link"].unique()
    frame.loc[~radio, "link"] = links[0]
    table = frame.pivot_table("cell", ["cycle", "leader"], "link", "first", fill_value="-")
    names = frame.loc[frame["link"] == links[0], ["cycle", "leader", "preview", "headway"]]
    order = [*map(tuple, names.sort_values("cycle", key=_places, kind="stable").to_numpy())]
    heads = ("trip", "leader known from", "preview", "mean headway:", *(f"{x}:" for x in links))
    cells = ((*name, *table.loc[name[:2], links]) for name in order)
    broken = frame[radio & (frame["broken_s"] > 0)]
    least = frame.loc[radio, "smallest_margin_m"].min()
    counts = (
        f"{len(frame)} drives, smallest true gap {frame['smallest_gap_m'].min():.2f} m, "
        f"{frame['fallback_ticks'].sum()} ticks of fallback. Of {radio.sum()} with messages, {len(broken)} "
        f"break s_min (smallest margin {least:.2f} m)."
    )
    return {"price": f"{markdown_table(heads, cells)}\n\n{counts}"}


def _places(names: pd.Series[str]) -> pd.Series[int]:
    """Return the place of each name among those that came before it."""
    return names.map({name: place for place, name in enumerate(names.unique())})
