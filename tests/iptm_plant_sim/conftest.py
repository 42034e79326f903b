"""A vehicle with the default parameters and roads that make it work."""

from collections.abc import Callable

import numpy as np
import pytest

from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.state import FloatArray
from iptm_plant_sim.plant import Plant


def level(positions_m: FloatArray) -> FloatArray:
    return np.zeros_like(positions_m)


def hills(positions_m: FloatArray) -> FloatArray:
    """Six per cent up and down, steep enough to regenerate."""
    return 0.06 * np.sin(positions_m / 150.0)


def climb(positions_m: FloatArray) -> FloatArray:
    return np.full_like(positions_m, 0.06)


@pytest.fixture(scope="session")
def parameters() -> ModelParameters:
    return load_parameters().values


@pytest.fixture
def make_plant(parameters: ModelParameters) -> Callable[..., Plant]:
    def make(slope: str = "level", step_s: float | None = None) -> Plant:
        slope_at = {"level": level, "hills": hills, "climb": climb}[slope]
        return (
            Plant(parameters, slope_at) if step_s is None else Plant(parameters, slope_at, step_s)
        )

    return make


@pytest.fixture
def plant(make_plant: Callable[..., Plant]) -> Plant:
    return make_plant()
