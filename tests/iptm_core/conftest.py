"""The shipped parameters, and one function evaluated in all the ways the physics promises."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters


@pytest.fixture(scope="session")
def parameters() -> ModelParameters:
    return load_parameters().values


@pytest.fixture(scope="session", params=["paper_calibrated", "published_chiller", "textbook_cell"])
def each_set(request: pytest.FixtureRequest) -> ModelParameters:
    return load_parameters(request.param).values


def _by_casadi(symbol: Any, function: Callable[..., Any], samples: NDArray[Any]) -> NDArray[Any]:
    names = [symbol.sym(f"x{index}") for index in range(samples.shape[1])]
    compiled = ca.Function("compiled", names, [function(*names)])
    return np.array([float(compiled(*map(float, row))) for row in samples])


@pytest.fixture(scope="session")
def agree_in_all_backends() -> Callable[..., None]:
    """Check that floats, NumPy arrays, CasADi SX and CasADi MX give the same numbers."""

    def check(function: Callable[..., Any], *columns: Any, rtol: float = 1e-13) -> None:
        samples = np.column_stack([np.asarray(column, dtype=float) for column in columns])
        one_by_one = np.array([function(*map(float, row)) for row in samples], dtype=float)
        assert np.all(np.isfinite(one_by_one))
        tolerance = {"rtol": rtol, "atol": rtol * float(np.max(np.abs(one_by_one)))}
        at_once = function(*samples.T)
        assert isinstance(at_once, np.ndarray)
        np.testing.assert_allclose(at_once, one_by_one, **tolerance)
        for symbol in (ca.SX, ca.MX):
            np.testing.assert_allclose(
                _by_casadi(symbol, function, samples), one_by_one, **tolerance
            )

    return check
