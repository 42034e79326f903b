"""The example bag, and the page of it as the view serves it."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm_core.trajectory import Trajectory
from iptm_recording.trajectory_reader import read_trajectory

BAG = Path(__file__).resolve().parents[2] / "bags" / "example_us06_120s"


@pytest.fixture(scope="session")
def bag() -> Path:
    return BAG


@pytest.fixture(scope="session")
def driven() -> Trajectory:
    """What the example bag holds, by the project's own reader."""
    return read_trajectory(BAG)
