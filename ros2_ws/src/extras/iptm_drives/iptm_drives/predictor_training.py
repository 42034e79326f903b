"""Train the regression that predicts a lead vehicle on recorded drives, and validate it on others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from iptm_core.errors import MeasurementError
from iptm_core.markdown import table_of
from iptm_core.routes import build_route
from iptm_core.state import FloatArray
from iptm_v2x_bridge.prediction.regression import (
    PAST_S,
    RegressionModel,
    bound_weights,
    regression_features,
)

LEADS_S = (1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 40, 60)
TABLE_LEADS_S = (1, 2, 5, 10, 20, 40, 60)
BOUND_SPEEDS_M_S = (0.0, 2.0, 6.0, 12.0, 20.0, 30.0)
BOUND_ACCELERATIONS_M_S2 = (-1.0, 0.0, 0.8)
LEVEL = 0.993
"""Level of the quantile regression: other drives keep about 99 %."""
RIDGE = 10.0
"""Weight of the squared coefficients, in samples of unit size."""
DECAY_S = 4.0
"""Time constant with which the acceleration of a leader decays, where nothing else is known of it."""
SAMPLES_BETWEEN = 5
"""Bounds are fitted to every fifth second, means to all of them."""


Drives = Mapping[str, FloatArray]
"""Speeds at steps of a second by name, shape (n,)."""


def read_drives(sources: Sequence[str]) -> dict[str, FloatArray]:
    """Return drives at steps of a second.

    Args:
        sources: driving cycles and recorded drives as in the parameter ``cycle``, and folders of CSV drives.

    Raises:
        IptmError: a source is not usable.
    """
    drives: dict[str, FloatArray] = {}
    for source in sources:
        paths = sorted(Path(source).glob("*.csv")) if Path(source).is_dir() else [source]
        if not paths:
            raise MeasurementError(
                f"{source} holds no file that ends in .csv; allowed: at least one"
            )
        for path in map(str, paths):
            motion = build_route(path, initial_gap_m=1.0).leader
            seconds = np.arange(motion.times_s[0], motion.times_s[-1] + 0.5)
            drives[Path(path).stem if len(paths) > 1 else path] = motion.speeds_at(seconds)
    return drives


HOLD_OUT_EVERY = 3
"""Every third trip, run, test or car is held out of a fit."""


def held_out(names: list[str]) -> set[str]:
    """Return every third of the names in alphabetical order: they are not fitted to."""
    return set(sorted(set(names))[HOLD_OUT_EVERY - 1 :: HOLD_OUT_EVERY])


def quantile_regression(weights: FloatArray, values: FloatArray, level: float) -> FloatArray:
    """Return the coefficients that minimise the pinball loss, by the dual linear program."""
    if weights.shape[1] == 1:
        return np.array([np.quantile(values, level)])
    found = linprog(
        -values,
        A_eq=weights.T,
        b_eq=(1.0 - level) * weights.sum(axis=0),
        bounds=(0.0, 1.0),
        method="highs",
    )
    return np.asarray(-found.eqlin.marginals, dtype=np.float64)


def predicted_distance_m(
    speed_m_s: FloatArray, acceleration_m_s2: FloatArray, lead_s: float
) -> FloatArray:
    """Return the distance covered with an acceleration that decays, up to a standstill."""
    a, v = acceleration_m_s2, speed_m_s
    gone = 1.0 - np.exp(-lead_s / DECAY_S)
    moved = v * lead_s + a * DECAY_S * (lead_s - DECAY_S * gone)
    halts = v + a * DECAY_S * gone < 0.0
    ratio = np.maximum(1.0 + v / np.where(halts, a * DECAY_S, -np.inf), 1e-12)
    halt_s = -DECAY_S * np.log(ratio)
    halted = 1.0 - np.exp(-halt_s / DECAY_S)
    stopping = v * halt_s + a * DECAY_S * (halt_s - DECAY_S * halted)
    distance: FloatArray = np.where(halts, np.maximum(stopping, 0.0), moved)
    return distance


def samples_of(drives: Drives) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return past and future of every second of drives, without their first and last seconds.

    Returns:
        Speeds now and in the seconds before, shape (n, `PAST_S` + 1); changes of speed and distances driven
        up to the lead times, shapes (n, leads).

    Raises:
        MeasurementError: no drive is long enough.
    """
    leads = np.array(LEADS_S)
    samples = []
    for speed in drives.values():
        now = np.arange(PAST_S, speed.size - LEADS_S[-1])[:, None]
        distance_m = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
        past = speed[now - np.arange(PAST_S + 1)]
        samples.append(
            (past, speed[now + leads] - speed[now], distance_m[now + leads] - distance_m[now])
        )
    if not sum(len(past) for past, *_ in samples):
        raise MeasurementError(
            f"{len(drives)} drives are too short; allowed: at least one of {PAST_S + LEADS_S[-1] + 1} s"
        )
    past, changes, driven = (np.concatenate(parts) for parts in zip(*samples, strict=True))
    return past, changes, driven


def train(drives: Drives, trained_on: str) -> RegressionModel:
    """Fit mean and bounds to all of the drives.

    Raises:
        MeasurementError: no drive is long enough.
    """
    past_m_s, changes_m_s, driven_m = samples_of(drives)
    features = regression_features(past_m_s)
    normal = features.T @ features + RIDGE * np.eye(features.shape[1])
    coefficients = np.linalg.solve(normal, features.T @ changes_m_s)
    without_bounds = RegressionModel(
        trained_on,
        tuple(drives),
        tuple(map(float, LEADS_S)),
        _rows(coefficients.T, 7),
        BOUND_SPEEDS_M_S,
        BOUND_ACCELERATIONS_M_S2,
        ((0.0,) * (len(BOUND_SPEEDS_M_S) * len(BOUND_ACCELERATIONS_M_S2)),) * len(LEADS_S),
    )
    _, expected_m, _ = without_bounds.at_leads(past_m_s)
    behind_m = expected_m[:, 1:] - driven_m
    weights = bound_weights(past_m_s, BOUND_SPEEDS_M_S, BOUND_ACCELERATIONS_M_S2)
    every = slice(None, None, SAMPLES_BETWEEN)
    bounds = [quantile_regression(weights[every], column, LEVEL) for column in behind_m[every].T]
    return RegressionModel(
        **{**vars(without_bounds), "bounds_m": _rows(np.maximum(np.array(bounds), 0.0), 3)}
    )


def _rows(table: NDArray[np.floating[Any]], digits: int) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(round(float(value), digits) for value in row) for row in table)


def evaluate(model: RegressionModel, drives: Drives) -> list[dict[str, float]]:
    """Return errors and coverage on drives, one row per lead time of `TABLE_LEADS_S`.

    Returns:
        ``lead_s``, rms of the position errors in m of the regression (``rms_m``) and of an acceleration that
        decays (``decay_rms_m``), mean bound in m, share of the seconds within the bound in percent.
    """
    past_m_s, _, driven_m = samples_of(drives)
    _, expected_m, bounds_m = model.at_leads(past_m_s)
    speed = past_m_s[:, 0]
    acceleration = speed - past_m_s[:, 1]
    rows = []
    for lead_s in TABLE_LEADS_S:
        column = LEADS_S.index(lead_s)
        error_m = expected_m[:, column + 1] - driven_m[:, column]
        decay_m = predicted_distance_m(speed, acceleration, float(lead_s))
        bound_m = bounds_m[:, column + 1]
        rows.append(
            {
                "lead_s": float(lead_s),
                "rms_m": float(np.sqrt(np.mean(error_m**2))),
                "decay_rms_m": float(np.sqrt(np.mean((decay_m - driven_m[:, column]) ** 2))),
                "bound_m": float(bound_m.mean()),
                "kept_percent": float(100.0 * np.mean(error_m <= bound_m + 1e-6)),
            }
        )
    return rows


def train_and_try(sources: Sequence[str], output: Path | None, source: str) -> None:
    """Train on two thirds of the drives, print the errors on the others, and write the model.

    Args:
        sources: cycles, recorded drives, and folders of CSV drives.
        output: file of the model; None for none.
        source: source and licence, noted in the model.
    """
    drives = read_drives(sources)
    others = held_out(list(drives))
    model = train({name: drives[name] for name in drives if name not in others}, source)
    tried = {name: drives[name] for name in drives if name in others}
    print(f"trained on {len(drives) - len(tried)} drives")
    if tried:
        columns = {
            "after": "{lead_s:g} s",
            "position error rms": "{rms_m:.2f} m",
            "with decaying acceleration": "{decay_rms_m:.2f} m",
            "mean bound": "{bound_m:.2f} m",
            "kept": "{kept_percent:.1f} %",
        }
        print(f"tried on {len(tried)} others:\n")
        print(table_of(evaluate(model, tried), columns))
    if output is not None:
        output.write_text(model.as_json(), encoding="utf-8")
        print(f"model: {output}")
