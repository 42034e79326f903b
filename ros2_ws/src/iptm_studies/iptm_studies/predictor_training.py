"""Train the regression that predicts a lead vehicle on recorded drives, and try it on others."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iptm_core.errors import IptmError, MeasurementError
from iptm_core.markdown import markdown_table
from iptm_core.program import EXIT_OK, refused
from iptm_core.routes import build_route
from iptm_core.state import FloatArray
from iptm_v2x_bridge.prediction.regression import (
    PAST_S,
    RegressionModel,
    bound_weights,
    regression_features,
)
from iptm_validation.lead_vehicle import predicted_distance_m, quantile_regression
from iptm_validation.measurements import Driver, held_out
from iptm_validation.readers.folder import excerpts, files_of, read_files

PROGRAM = "train_predictor"
LEADS_S = (1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 40, 60)
TABLE_LEADS_S = (1, 2, 5, 10, 20, 40, 60)
BOUND_SPEEDS_M_S = (0.0, 2.0, 6.0, 12.0, 20.0, 30.0)
BOUND_ACCELERATIONS_M_S2 = (-1.0, 0.0, 0.8)
LEVEL = 0.993
"""Level of the quantile regression: other drives keep about 99 %."""
RIDGE = 10.0
"""Weight of the squared coefficients, in samples of unit size."""
SAMPLES_BETWEEN = 5
"""Bounds are fitted to every fifth second, means to all of them."""


@dataclass(frozen=True, eq=False)
class SpeedRecord:
    """A drive at 1 Hz.

    Attributes:
        name: unique name.
        speed_m_s: speeds, shape (n,).
    """

    name: str
    speed_m_s: FloatArray


@dataclass(frozen=True, eq=False)
class Samples:
    """Past and future of every second of some drives.

    Attributes:
        past_m_s: speeds now and in the seconds before, shape (n, `PAST_S` + 1).
        changes_m_s: changes of speed up to the lead times, shape (n, leads).
        driven_m: distances driven up to the lead times, shape (n, leads).
    """

    past_m_s: FloatArray
    changes_m_s: FloatArray
    driven_m: FloatArray


def read_drives(sources: Sequence[str]) -> list[SpeedRecord]:
    """Return the drives of folders and files.

    Args:
        sources: folders of measured drives (as of `scripts/validate --data`), of which those on public roads
            count, and driving cycles or recorded drives as in the parameter `cycle`.

    Raises:
        IptmError: a source is not usable.
    """
    drives = []
    for source in sources:
        if Path(source).is_dir():
            drives += _measured(Path(source))
            continue
        motion = build_route(source, initial_gap_m=1.0).leader
        seconds = np.arange(motion.times_s[0], motion.times_s[-1] + 0.5)
        drives.append(SpeedRecord(source, motion.speeds_at(seconds)))
    return drives


def _measured(folder: Path) -> list[SpeedRecord]:
    found = read_files(files_of(folder), lambda text: print(f"{PROGRAM}: {text}", file=sys.stderr))
    return [
        SpeedRecord(drive.name, drive.speed_m_s)
        for drive in found.drives
        if drive.driver is Driver.ROAD
        and drive.step_s == 1.0
        and np.isfinite(drive.speed_m_s).all()
    ]


def samples_of(drives: Sequence[SpeedRecord]) -> Samples:
    """Return the samples of drives, without their first and last seconds.

    Raises:
        MeasurementError: no drive is long enough.
    """
    leads = np.array(LEADS_S)
    pasts, changes, driven = [], [], []
    for drive in drives:
        speed = drive.speed_m_s
        at = np.arange(PAST_S, speed.size - LEADS_S[-1])
        way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
        pasts.append(speed[at[:, None] - np.arange(PAST_S + 1)])
        changes.append(speed[at[:, None] + leads] - speed[at, None])
        driven.append(way[at[:, None] + leads] - way[at, None])
    if not sum(len(past) for past in pasts):
        raise MeasurementError(
            f"{len(drives)} drives are too short; allowed: at least one of {PAST_S + LEADS_S[-1] + 1} s"
        )
    return Samples(np.concatenate(pasts), np.concatenate(changes), np.concatenate(driven))


def train(drives: Sequence[SpeedRecord], trained_on: str) -> RegressionModel:
    """Fit mean and bounds to all of the drives.

    Raises:
        MeasurementError: no drive is long enough.
    """
    samples = samples_of(drives)
    features = regression_features(samples.past_m_s)
    normal = features.T @ features + RIDGE * np.eye(features.shape[1])
    coefficients = np.linalg.solve(normal, features.T @ samples.changes_m_s)
    without_bounds = RegressionModel(
        trained_on,
        tuple(drive.name for drive in drives),
        tuple(map(float, LEADS_S)),
        _rows(coefficients.T, 7),
        BOUND_SPEEDS_M_S,
        BOUND_ACCELERATIONS_M_S2,
        ((0.0,) * (len(BOUND_SPEEDS_M_S) * len(BOUND_ACCELERATIONS_M_S2)),) * len(LEADS_S),
    )
    _, expected_m, _ = without_bounds.at_leads(samples.past_m_s)
    behind_m = expected_m[:, 1:] - samples.driven_m
    weights = bound_weights(samples.past_m_s, BOUND_SPEEDS_M_S, BOUND_ACCELERATIONS_M_S2)
    every = slice(None, None, SAMPLES_BETWEEN)
    bounds = [quantile_regression(weights[every], column, LEVEL) for column in behind_m[every].T]
    return RegressionModel(
        **{**vars(without_bounds), "bounds_m": _rows(np.maximum(np.array(bounds), 0.0), 3)}
    )


def _rows(table: NDArray[np.floating[Any]], digits: int) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(round(float(value), digits) for value in row) for row in table)


def evaluate(model: RegressionModel, drives: Sequence[SpeedRecord]) -> list[dict[str, float]]:
    """Return errors and coverage on drives, one row per lead time of `TABLE_LEADS_S`.

    Returns:
        ``lead_s``, rms of the position errors in m of the regression (``rms_m``) and of an acceleration that
        decays (``decay_rms_m``), mean bound in m, share of the seconds within the bound in percent.
    """
    samples = samples_of(drives)
    _, expected_m, bounds_m = model.at_leads(samples.past_m_s)
    speed = samples.past_m_s[:, 0]
    acceleration = speed - samples.past_m_s[:, 1]
    rows = []
    for lead_s in TABLE_LEADS_S:
        column = LEADS_S.index(lead_s)
        error_m = expected_m[:, column + 1] - samples.driven_m[:, column]
        decay_m = predicted_distance_m(speed, acceleration, float(lead_s))
        bound_m = bounds_m[:, column + 1]
        rows.append(
            {
                "lead_s": float(lead_s),
                "rms_m": float(np.sqrt(np.mean(error_m**2))),
                "decay_rms_m": float(
                    np.sqrt(np.mean((decay_m - samples.driven_m[:, column]) ** 2))
                ),
                "bound_m": float(bound_m.mean()),
                "kept_percent": float(100.0 * np.mean(error_m <= bound_m + 1e-6)),
            }
        )
    return rows


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(PROGRAM, description=__doc__)
    parser.add_argument(
        "sources",
        nargs="*",
        metavar="DRIVES",
        help="folders of measured drives, and cycles or recorded drives (default: excerpts of the project)",
    )
    parser.add_argument(
        "--output", type=Path, metavar="FILE", help="write the model there, for regression_model"
    )
    parser.add_argument("--source", default="", help="source and licence, to be noted in the model")
    return parser.parse_args(arguments)


def _run(options: argparse.Namespace) -> None:
    drives = read_drives(options.sources or [str(excerpts())])
    others = held_out([drive.name for drive in drives])
    model = train([drive for drive in drives if drive.name not in others], options.source)
    tried = [drive for drive in drives if drive.name in others]
    print(f"trained on {len(drives) - len(tried)} drives")
    if tried:
        heads = ("after", "position error rms", "with decaying acceleration", "mean bound", "kept")
        cells = (
            "{lead_s:g} s",
            "{rms_m:.2f} m",
            "{decay_rms_m:.2f} m",
            "{bound_m:.2f} m",
            "{kept_percent:.1f} %",
        )
        rows = evaluate(model, tried)
        print(f"tried on {len(tried)} others:\n")
        print(markdown_table(heads, ([cell.format_map(row) for cell in cells] for row in rows)))
    if options.output is not None:
        options.output.write_text(model.as_json(), encoding="utf-8")
        print(f"model: {options.output}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; exit code 2 if something was refused."""
    options = _options(arguments)
    try:
        _run(options)
    except IptmError as error:
        return refused(PROGRAM, error)
    except OSError as error:
        return refused(PROGRAM, f"{error.filename}: {error.strerror}")
    return EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
