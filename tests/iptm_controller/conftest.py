"""Fixtures of the controller's tests; what they build on is in `scenes`."""

from __future__ import annotations

import pytest
from tests.iptm_controller.scenes import SCENES

from iptm_controller.measurements import Measurements


@pytest.fixture(params=sorted(SCENES))
def ordinary_scene(request: pytest.FixtureRequest) -> Measurements:
    """One ordinary situation after the other."""
    return SCENES[request.param]
