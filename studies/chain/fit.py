"""Fit of the law of car following to platoons: coefficients, spread, and bounds that hold on other runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from studies.chain.platoons import FITTED_TO, LEADS_S, Instants

from iptm_core.state import FloatArray
from iptm_its.car_following import FollowingLaw, following_features

RIDGE = 30.0
SWEEPS = 500


def fitted_law(instants: Instants) -> FollowingLaw:
    """Return the law of some instants.

    Coefficients come from ridge regression, the spread from non-negative least squares of the sizes of the
    errors. Both, and the multiples of the spread that bounds are, from errors on runs that the coefficients
    are not fitted to.
    """
    error = np.zeros_like(instants.driven_m)
    for run in np.unique(instants.run):
        inside = instants.run == run
        part = instants.where(inside)
        law = _with_law(instants.where(~inside))
        error[inside] = part.driven_m - law.motion(part.past).driven_m[:, 1:]
    law = _with_law(instants)
    of_spread = following_features(instants.past)[1]
    spread = np.column_stack([_non_negative(of_spread, abs(column)) for column in error.T])
    ratio = error / np.maximum(of_spread @ spread, 1e-6)
    of_runs = [ratio[instants.run == run] for run in np.unique(instants.run)]
    return replace(
        law,
        spread=spread,
        half_90=_for_another_run([np.quantile(abs(each), 0.9, axis=0) for each in of_runs]),
        behind_99=_for_another_run([-np.quantile(each, 0.01, axis=0) for each in of_runs]),
    )


def _for_another_run(multiples: list[FloatArray]) -> FloatArray:
    """Return the mean of what runs need and a standard deviation more, as runs differ; 0 at lead time 0."""
    needed = np.mean(multiples, axis=0) + np.std(multiples, axis=0)
    return np.concatenate([[0.0], needed])


def _with_law(instants: Instants) -> FollowingLaw:
    features, of_spread = following_features(instants.past)
    square = features.T @ features + RIDGE * np.eye(features.shape[1])
    changes = instants.speeds_m_s - instants.past.speed_m_s[:, :1]
    law = np.asarray(np.linalg.solve(square, features.T @ changes), dtype=np.float64)
    leads, ones = np.array(LEADS_S), np.ones(len(LEADS_S) + 1)
    return FollowingLaw(
        FITTED_TO, leads, law, np.zeros((of_spread.shape[1], leads.size)), ones, ones
    )


def _non_negative(features: FloatArray, values: FloatArray) -> FloatArray:
    """Return the non-negative coefficients of a least-squares fit, by coordinate descent."""
    square, right = features.T @ features, features.T @ values
    found = np.zeros(features.shape[1])
    for _ in range(SWEEPS):
        for place in range(found.size):
            rest = right[place] - square[place] @ found + square[place, place] * found[place]
            found[place] = max(rest / square[place, place], 0.0)
    return found
