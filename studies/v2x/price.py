"""Measures the price of not knowing the leader's future: known from a file, and from messages.

Each row drives the whole trip without ROS; the messages are real bits that are sent, lost, delayed and read.
The price is the difference in degradation between a leader that only an exact range sensor sees and one that
is known from the file; what each predictor recovers of it is counted. Finished rows are kept in a file and
not driven again.
"""

from __future__ import annotations

import json
import sys
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from iptm.parts import (
    CamBridge,
    CamSender,
    Controller,
    ControllerOptions,
    ControllerSettings,
    CycleSource,
    FloatArray,
    Foresight,
    GAIN_FACTOR,
    GAP_TOLERANCE_M,
    History,
    Horizon,
    LearntProfile,
    Plant,
    Predictor,
    PreviewMode,
    PreviewSettings,
    ROUTE_CYCLES,
    ReceivedPath,
    Regression,
    RegressionModel,
    RoadLine,
    Route,
    Rung,
    SenderSettings,
    SimulatedRadio,
    TickBridge,
    V2xBridge,
    build_route,
    compute_metrics,
    gap_margins_m,
    load_parameters,
    markdown_table,
    read_drives,
    run_closed_loop,
    strategy_by_name,
)
from studies.speed.harness import run_benchmark
from studies.v2x.prediction import EARLIER_DRIVES, PAGE, other_drive
from studies.measured_cycles import FASTEST_M_S, lead_cycles, write_drive

FILE, SENSOR = "file", "range sensor only"
DECAY, PATH = "decaying acceleration", "path prediction"
EARLIER, REGRESSION = "earlier drives", "regression"
LEADERS = (DECAY, PATH, EARLIER, REGRESSION)
MEASURED = ("A11", "A23", "B24", "no_ACC__handling_part22_2")
"""Lead vehicles of the excerpts of `iptm_validation` that no predictor was fitted to: three trips of an i3 on
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
FIT_S = 600.0
"""Beginning of a trip of the data set that is driven, capped at `FASTEST_M_S`."""
KEY = ["cycle", "leader", "accuracy_m", "loss", "delay_s"]


def predictors_of(leader: str, route: Route) -> tuple[Predictor, ...]:
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


@lru_cache(maxsize=1)
def measured_cycles(data: str = "") -> dict[str, str]:
    """Return measured lead vehicles as drive files, by name: those of the project, and trips of a folder."""
    folder = Path(tempfile.mkdtemp(prefix="lead_vehicles_"))
    found = lead_cycles(None, folder, lambda text: print(text, file=sys.stderr), count=1000)
    trips = {
        name: str(write_drive(folder / f"fit_{name}.csv", 1.0, np.minimum(speeds, FASTEST_M_S)))
        for name, speeds in _beginnings(data).items()
    }
    return trips | {Path(path).stem: path for path in found}


def _beginnings(data: str) -> dict[str, FloatArray]:
    drives = read_drives([data]) if data else {}
    return {name: speeds[: int(FIT_S)] for name, speeds in drives.items()}


def drive(
    cycle: str,
    leader: str,
    accuracy_m: float = 0.0,
    loss: float = 0.0,
    delay_s: float = 0.0,
    duration_s: float | None = None,
    seed: int = 1,
    data: str = "",
) -> dict[str, Any]:
    """Drive one trip and return its figures."""
    parameters = load_parameters().values
    name = cycle if cycle in ROUTE_CYCLES else measured_cycles(data).get(cycle, cycle)
    route = build_route(name, initial_gap_m=parameters.gap.initial_gap_m, duration_s=duration_s)
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
    loop = run_closed_loop(route, plant, Controller(parameters, options), bridge=bridge)
    run = compute_metrics(loop.trajectory, parameters, loop.decisions)
    beyond_m = loop.trajectory.gap_m - parameters.gap.max_gap_m
    broken = gap_margins_m(loop.trajectory, parameters) < -GAP_TOLERANCE_M
    return {
        **dict(zip(KEY, (cycle, leader, accuracy_m, loss, delay_s), strict=True)),
        "degradation_1e7": 1e7 * run.degradation,
        "battery_energy_kj": 1e-3 * run.battery_energy_j,
        "smallest_gap_m": run.smallest_gap_m,
        "smallest_margin_m": run.smallest_margin_m,
        "above_s_max_s": int(np.count_nonzero(beyond_m > GAP_TOLERANCE_M)),
        "above_s_max_m": max(float(beyond_m.max()), 0.0),
        "broken_s": int(np.count_nonzero(broken)),
        "fallback_ticks": int(np.count_nonzero(np.asarray(loop.decisions.rung) != Rung.OPTIMAL)),
    }


def measure(
    cycle: tuple[str, ...] = TRIPS,
    leader: tuple[str, ...] = LEADERS,
    duration_s: float = 0.0,
    seed: int = 1,
    cells: int = len(CELLS),
    rows: str = "",
    finished: int = 0,
    data: str = "",
) -> list[dict[str, Any]]:
    """Measure all cases.

    Args:
        cycle: trip of the leader, a driving cycle or a measured lead vehicle; may be repeated.
        leader: how it is predicted, in addition to file and range sensor; may be repeated.
        duration_s: length of the trips, s; 0 for all of them.
        seed: of loss.
        cells: how many of the pairs of accuracy and link, the most usual ones first.
        rows: file of finished rows, which are not driven again.
        finished: 1 drives nothing and takes the finished rows only.
        data: folder of the data set, for its trips by name (as of `scripts/validate --data`).
    """
    cases = [(trip, known, 0.0, 0.0, 0.0) for known in (FILE, SENSOR) for trip in cycle]
    cases += [(trip, who, *cell) for cell in CELLS[:cells] for who in leader for trip in cycle]
    store = Path(rows) if rows else None
    found: dict[tuple[Any, ...], dict[str, Any]] = {}
    for line in store.read_text("utf-8").splitlines() if store and store.exists() else ():
        row = json.loads(line)
        if (row["for_s"], row["seed"]) == (duration_s, seed):
            found[tuple(row[name] for name in KEY)] = row
    if finished:
        cases = [case for case in cases if case in found]
    for case in (case for case in cases if case not in found):
        row = drive(*case, duration_s or None, seed, data) | {"for_s": duration_s, "seed": seed}
        found[case] = row
        print(json.dumps(row), file=sys.stderr, flush=True)
        if store is not None:
            with store.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
    for case in cases:
        row, exact, plain = (
            found[case if known is None else (case[0], known, 0.0, 0.0, 0.0)]
            for known in (None, FILE, SENSOR)
        )
        ageing, least, most = (each["degradation_1e7"] for each in (row, exact, plain))
        row["degradation_change"] = 100.0 * (ageing / least - 1.0)
        row["recovered_percent"] = 100.0 * (most - ageing) / (most - least)
    return [found[case] for case in cases]


def as_table(rows: list[dict[str, Any]]) -> dict[str, str]:
    """Return the rows as a table in Markdown: trips and leaders by accuracy and link."""
    frame = pd.DataFrame(rows)
    change, share = "{degradation_change:+.1f} %", "{recovered_percent:.0f} %"
    cell = f"{change}, {share}, {{smallest_margin_m:.2f}} m".format
    frame["cell"] = [cell(**row) for row in rows]
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
    names = frame[["cycle", "leader"]].drop_duplicates()
    order = [*map(tuple, names.sort_values("cycle", key=_places, kind="stable").to_numpy())]
    heads = ("trip", "leader known from", *(f"{link}:" for link in links))
    cells = ((*name, *table.loc[name, links]) for name in order)
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


if __name__ == "__main__":
    sys.exit(run_benchmark(measure, text_of=as_table, page=PAGE))
