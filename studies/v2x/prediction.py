"""Measures how well the predictors of the V2X bridge foretell a leader on cycles they were not fitted on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from iptm_core.markdown import table_of
from iptm_core.parameters import load_parameters
from iptm_core.road_ahead import SpeedLimits
from iptm_core.routes import build_route
from iptm_core.routes.cycles import LeaderMotion
from iptm_core.routes.road_line import RoadLine
from iptm_core.units import KM_H_PER_M_S
from iptm_traffic.drive import opened_traffic
from iptm_traffic.trip import PredictionInput, TrafficDrive
from iptm_v2x_bridge.messages.cam import decode_datagram
from iptm_v2x_bridge.prediction.expected_motion import History, LearntProfile
from iptm_v2x_bridge.prediction.predictor import (
    LeaderPredictor,
    LeaderTrack,
    PredictorName,
    ReceivedPath,
)
from iptm_v2x_bridge.prediction.regression import Regression, RegressionModel
from iptm_v2x_bridge.prediction.road_rules import BoundedByRules, RoadRules
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.sender import CamSender
from iptm_v2x_bridge.settings import SenderSettings
from iptm_v2x_bridge.stations.plausibility import Heard
from iptm_v2x_bridge.stations.station import Station, leader_track

# The bounds of the predictors were read off udds, hwfet, us06 and sc03.
NOT_FITTED_ON = ("wltc_class3b", "nycc")
LEADS_S = (1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 60.0)
LAST_SECOND_MS = range(-1000, 1, 100)
BEFORE_MS = range(-11_000, -1000, 1000)
"""When messages were heard, against the present: once a second, and ten times in the last one."""
EARLIER_DRIVES = 5
LIMITS_KM_H = (30.0, 50.0, 70.0, 100.0, 130.0)
LIMIT_LENGTH_M = 500.0
SHORTEST_STAY_S = 180.0
"""Stay of a car on the corridor that is worth looking at."""
IN_TRAFFIC_EVERY_S = 10.0


def track_at(sender: CamSender, road: RoadLine, time_ms: int, since_ms: int = 0) -> LeaderTrack:
    """Return the leader's track after some seconds of messages, through the bits of the wire.

    Args:
        sender: sends them.
        road: the road that they are projected onto.
        time_ms: the present.
        since_ms: nothing was heard before.
    """
    station: Station | None = None
    heard_ms = [time_ms + past_ms for past_ms in (*BEFORE_MS, *LAST_SECOND_MS)]
    for at_ms in (at_ms for at_ms in heard_ms if at_ms >= since_ms):
        read = decode_datagram(sender.datagram_at(at_ms * 1_000_000))
        if isinstance(read, Rejection):
            raise SystemExit(f"own message is rejected: {read}")
        if station is None:
            station = Station(Heard(read[0], at_ms), road)
        else:
            station.update(Heard(read[0], at_ms))
    if station is None:
        raise SystemExit("no message")
    return leader_track(station)


def other_drive(motion: LeaderMotion, source: np.random.Generator) -> LeaderMotion:
    """Return the drive of another driver, or of another day, on the same road.

    Speeds differ by 8 % (standard deviation) over some 300 m, and each stop takes 0.3 to 1.7 times as long.
    """
    times, speeds = motion.times_s, motion.speeds_m_s
    positions = motion.positions_m
    stands = (speeds[1:] + speeds[:-1]) < 1.0
    knots = np.arange(positions[0], positions[-1] + 300.0, 300.0)
    factor = np.exp(0.08 * source.standard_normal(knots.size))
    steps = np.diff(times) / np.interp(0.5 * (positions[1:] + positions[:-1]), knots, factor)
    begins = np.concatenate([[True], stands[1:] != stands[:-1]])
    lengths = source.uniform(0.3, 1.7, int(begins.sum()))[np.cumsum(begins) - 1]
    steps = np.where(stands, np.diff(times) * lengths, steps)
    moments = np.concatenate([[0.0], np.cumsum(steps)])
    seconds = np.arange(0.0, moments[-1] + 1.0)
    driven = np.interp(seconds, moments, positions)
    speeds_1hz = np.concatenate([[0.0], np.maximum(np.gradient(driven)[1:-1], 0.0), [0.0]])
    return LeaderMotion(seconds, speeds_1hz, float(positions[0]))


def limits_of(motion: LeaderMotion) -> SpeedLimits:
    """Return the lowest usual limits that the drive itself keeps, on stretches of 500 m."""
    starts = np.arange(motion.positions_m[0], motion.positions_m[-1] + 1.0, LIMIT_LENGTH_M)
    cells = ((motion.positions_m - starts[0]) / LIMIT_LENGTH_M).astype(int)
    fastest = np.array(
        [motion.speeds_m_s[cells == cell].max(initial=0.0) for cell in range(starts.size)]
    )
    choices = np.array(LIMITS_KM_H) / KM_H_PER_M_S
    above = np.minimum(np.searchsorted(choices, fastest - 0.5), choices.size - 1)
    return SpeedLimits(starts, choices[above])


Case = tuple[PredictorName, LeaderMotion, LeaderPredictor]
"""Predictor, and the future motion of the leader."""


def on_cycle(cycle: str) -> list[Case]:
    """Return the predictors that need no traffic, each with the drive of a leader."""
    source = np.random.default_rng(1)
    planned = build_route(cycle, initial_gap_m=15.0).leader
    earlier = [other_drive(planned, source) for _ in range(EARLIER_DRIVES)]
    driven = other_drive(planned, source)
    learnt = LearntProfile([(drive.positions_m, drive.speeds_m_s) for drive in earlier])
    limited = BoundedByRules(History(), RoadRules(limits_of(planned)))
    return [
        (PredictorName.RECEIVED_PATH, planned, ReceivedPath()),
        (PredictorName.LEARNT_PROFILE, driven, learnt),
        (PredictorName.SPEED_LIMITS, planned, limited),
        (PredictorName.REGRESSION, planned, Regression(RegressionModel.load())),
        (PredictorName.HISTORY, planned, History()),
    ]


def in_traffic(duration_s: float) -> tuple[list[Case], RoadLine]:
    """Return signals and history on cars that stay long on a simulated corridor, and the road of that.

    Raises:
        IptmError: SUMO is not installed or fails.
    """
    drive = TrafficDrive(knowledge=PredictionInput.PATH, duration_s=duration_s)
    with opened_traffic(drive, load_parameters().values) as (simulation, rehearsal):
        network, road = simulation.network, simulation.network.road.road_line()
    bounded = BoundedByRules(History(), network.rules)
    cases: list[Case] = []
    for seen in (rehearsal or {}).values():
        times, positions, _ = seen
        if times[-1] - times[0] >= SHORTEST_STAY_S:
            speeds = np.maximum(np.gradient(positions, times), 0.0)
            speeds[-1] = 0.0  # as a motion ends; nothing is asked about the last minute
            motion = LeaderMotion(times, speeds, float(positions[0]))
            cases.append((PredictorName.SIGNALS, motion, bounded))
            cases.append((PredictorName.HISTORY, motion, History()))
    return cases, road


def errors(
    cases: list[Case], road: RoadLine, every_s: float, until_before_end_s: float = 1.0
) -> pd.DataFrame:
    """Return speed and position errors (predicted less true) and bounds of each prediction at `LEADS_S`.

    Args:
        cases: pairs of predictor and motion.
        road: the road that the messages are projected onto.
        every_s: time between two predictions.
        until_before_end_s: time of the last prediction before the end of a drive.
    """
    found = []
    for name, motion, predictor in cases:
        sender = CamSender(motion, road, SenderSettings())
        begin_s, end_s = motion.times_s[0], motion.times_s[-1] - until_before_end_s
        # After a second of messages, between samples and points of paths.
        for time_s in np.arange(begin_s + 1.7, end_s, every_s):
            track = track_at(sender, road, round(1000.0 * time_s), round(1000.0 * begin_s))
            predicted = predictor.predict(track, time_s + np.array(LEADS_S))
            if predicted is not None:
                times = predicted.times_s  # a path may end before the last lead time
                behind_m = predicted.positions_m - motion.positions_at(times)
                values = {
                    "predictor": str(name),
                    "lead_s": LEADS_S[: times.size],
                    "speed_m_s": predicted.speeds_m_s - motion.speeds_at(times),
                    "position_m": behind_m,
                    "bound_m": predicted.bounds_m,
                    "covered_percent": 100.0 * (behind_m <= predicted.bounds_m),
                }
                found.append(pd.DataFrame(values))
    return pd.concat(found)


def summary(found: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the rows of the table."""
    by_lead = found.groupby(["predictor", "lead_s"])
    rows = by_lead[["bound_m", "covered_percent"]].mean()
    rows["speed_rms_m_s"] = by_lead["speed_m_s"].apply(_rms)
    rows["speed_max_m_s"] = by_lead["speed_m_s"].apply(lambda errors: errors.abs().max())
    rows["position_rms_m"] = by_lead["position_m"].apply(_rms)
    rows["ahead_99_m"] = by_lead["position_m"].quantile(0.99)
    order = [str(name) for name in PredictorName if str(name) in set(found["predictor"])]
    return [dict(row) for row in rows.loc[order].reset_index().to_dict("records")]


def _rms(values: pd.Series[float]) -> float:
    return float(np.sqrt((values**2).mean()))


def measure(
    every_s: float = 3.0, cycle: tuple[str, ...] = NOT_FITTED_ON, traffic_s: float = 600.0
) -> dict[str, Any]:
    """Measure all predictors.

    Args:
        every_s: time between two predictions, s.
        cycle: driving cycle, may be repeated.
        traffic_s: length of the simulated traffic in which signals are looked at, s; 0 leaves it out.
    """
    road = RoadLine.test_road()
    rows = summary(pd.concat([errors(on_cycle(name), road, every_s) for name in cycle]))
    numbers: dict[str, Any] = {"cycles": list(cycle), "rows": rows}
    if traffic_s > 0.0:
        cases, corridor = in_traffic(traffic_s)
        found = errors(cases, corridor, IN_TRAFFIC_EVERY_S, LEADS_S[-1])
        numbers |= {"traffic_rows": summary(found), "cars": len(cases) // 2}
    return numbers


COLUMNS = {
    "predictor": "`{predictor}`",
    "after:": "{lead_s:g} s",
    "speed error rms:": "{speed_rms_m_s:.2f} m/s",
    "largest:": "{speed_max_m_s:.2f} m/s",
    "position error rms:": "{position_rms_m:.2f} m",
    "99 % of the leaders at most this much behind:": "{ahead_99_m:.2f} m",
    "bound reported:": "{bound_m:.2f} m",
    "kept:": "{covered_percent:.0f} %",
}


def as_table(numbers: dict[str, Any]) -> dict[str, str]:
    """Return the numbers as a table in Markdown."""
    text = f"Cycles: {', '.join(numbers['cycles'])}\n\n" + table_of(numbers["rows"], COLUMNS)
    if "cars" in numbers:
        text += f"\n\nIn simulated traffic with signals, {numbers['cars']} cars:\n\n"
        text += table_of(numbers["traffic_rows"], COLUMNS)
    return {"prediction": text}
