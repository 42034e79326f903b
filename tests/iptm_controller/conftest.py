"""Fixtures of the controller's tests; what they build on is in `scenes`."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest
from tests.iptm_controller.scenes import SCENES, make_forecaster

from iptm_controller.forecast import LeaderForecaster
from iptm_controller.measurements import Measurements


@pytest.fixture(params=sorted(SCENES))
def ordinary_scene(request: pytest.FixtureRequest) -> Measurements:
    """One ordinary situation after the other."""
    return SCENES[request.param]


@pytest.fixture
def forecaster() -> LeaderForecaster:
    """Over the default horizon."""
    return make_forecaster()


@pytest.fixture
def compilations(cache: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Command lines of the compiler, questions for its version left out."""
    del cache
    commands: list[list[str]] = []
    original = subprocess.Popen

    def start(command: list[str], **options: Any) -> Any:
        if "--version" not in command:
            commands.append(command)
        return original(command, **options)

    monkeypatch.setattr(subprocess, "Popen", start)
    return commands
