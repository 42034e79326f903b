"""Measures how well the predictors of the V2X bridge foretell a leader on cycles they were not fitted on."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from benchmarks.harness import formatted_table, run_benchmark
from iptm_core.routes import build_route
from iptm_core.routes.leader import LeaderMotion
from iptm_core.routes.road_line import RoadLine
from iptm_core.state import FloatArray
from iptm_v2x_bridge.messages.cam_codec import decode_datagram
from iptm_v2x_bridge.prediction.history import History
from iptm_v2x_bridge.prediction.knowledge import knowledge_of
from iptm_v2x_bridge.prediction.learnt_profile import LearntProfile
from iptm_v2x_bridge.prediction.predictor import Knowledge, Predictor, PredictorName
from iptm_v2x_bridge.prediction.received_path import ReceivedPath
from iptm_v2x_bridge.prediction.speed_limits import BoundedBySpeedLimits, SpeedLimits
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.sending.sender import CamSender
from iptm_v2x_bridge.sending.settings import SenderSettings
from iptm_v2x_bridge.stations.station import Station

# The bounds of the predictors were read off udds, hwfet, us06 and sc03.
NOT_FITTED_ON = ("wltc_class3b", "nycc")
LEADS_S = (1.0, 2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 60.0)
HISTORY_MS = 1000
EARLIER_DRIVES = 5
LIMITS_KM_H = (30.0, 50.0, 70.0, 100.0, 130.0)
LIMIT_LENGTH_M = 500.0


def knowledge_at(sender: CamSender, road: RoadLine, time_ms: int) -> Knowledge:
    """Return what a receiver knows after a second of messages, through the bits of the wire."""
    station: Station | None = None
    for at_ms in range(time_ms - HISTORY_MS, time_ms + 1, 100):
        read = decode_datagram(sender.datagram_at(at_ms * 1_000_000))
        if isinstance(read, Rejection):
            raise SystemExit(f"own message is rejected: {read}")
        if station is None:
            station = Station(read[0], at_ms, road)
        else:
            station.update(read[0], at_ms)
    if station is None:
        raise SystemExit("no message")
    return knowledge_of(station, road)


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
    choices = np.array(LIMITS_KM_H) / 3.6
    above = np.minimum(np.searchsorted(choices, fastest - 0.5), choices.size - 1)
    return SpeedLimits(starts, choices[above])


def errors(cycle: str, every_s: float) -> dict[PredictorName, list[dict[str, FloatArray]]]:
    """Return speed and position errors (predicted less true) of each predictor at `LEADS_S`."""
    source = np.random.default_rng(1)
    planned = build_route(cycle, initial_gap_m=15.0).leader
    earlier = [other_drive(planned, source) for _ in range(EARLIER_DRIVES)]
    driven = other_drive(planned, source)
    road = RoadLine.test_road()
    predictors: Mapping[PredictorName, tuple[LeaderMotion, Predictor]] = {
        PredictorName.RECEIVED_PATH: (planned, ReceivedPath()),
        PredictorName.LEARNT_PROFILE: (
            driven,
            LearntProfile([(drive.positions_m, drive.speeds_m_s) for drive in earlier]),
        ),
        PredictorName.SPEED_LIMITS: (planned, BoundedBySpeedLimits(History(), limits_of(planned))),
        PredictorName.HISTORY: (planned, History()),
    }
    found: dict[PredictorName, list[dict[str, FloatArray]]] = {name: [] for name in predictors}
    leads = np.array(LEADS_S)
    for name, (motion, predictor) in predictors.items():
        sender = CamSender(motion, road, SenderSettings())
        for time_s in np.arange(0.5, motion.times_s[-1] - 1.0, every_s):  # between the samples
            known = knowledge_at(sender, road, round(1000.0 * time_s))
            times = time_s + leads
            told = predictor.predict(known, times)
            if told is None or told.times_s.size < times.size:
                continue
            found[name].append(
                {
                    "speed": told.speeds_m_s - motion.speeds_at(times),
                    "position": told.positions_m - motion.positions_at(times),
                    "bound": told.bounds_m,
                }
            )
    return found


def measure(every_s: float = 3.0, cycle: tuple[str, ...] = NOT_FITTED_ON) -> dict[str, Any]:
    """Measure all predictors.

    Args:
        every_s: time between two predictions, s.
        cycle: driving cycle, may be repeated.
    """
    rows = []
    everything = [errors(name, every_s) for name in cycle]
    for name in PredictorName:
        cases = [case for found in everything for case in found[name]]
        speed, position, bound = (
            np.array([case[what] for case in cases]) for what in ("speed", "position", "bound")
        )
        for index, lead_s in enumerate(LEADS_S):
            rows.append(
                {
                    "predictor": str(name),
                    "lead_s": lead_s,
                    "speed_rms_m_s": float(np.sqrt(np.mean(speed[:, index] ** 2))),
                    "speed_max_m_s": float(np.abs(speed[:, index]).max()),
                    "position_rms_m": float(np.sqrt(np.mean(position[:, index] ** 2))),
                    "ahead_99_m": float(np.quantile(position[:, index], 0.99)),
                    "bound_m": float(bound[:, index].mean()),
                    "covered_percent": float(
                        100.0 * np.mean(position[:, index] <= bound[:, index])
                    ),
                    "predictions": len(cases),
                }
            )
    return {"cycles": list(cycle), "rows": rows}


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


def as_table(numbers: dict[str, Any]) -> str:
    """Return the numbers as a table in Markdown."""
    return f"Cycles: {', '.join(numbers['cycles'])}\n\n" + formatted_table(numbers["rows"], COLUMNS)


if __name__ == "__main__":
    sys.exit(run_benchmark(measure, text_of=as_table))
