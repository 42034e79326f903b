"""Fixtures of the controller's tests; what they build on is in `scenes`."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any

import pytest
from tests.iptm_controller.scenes import SCENES

from iptm_controller.measurements import Measurements
from iptm_core.compilation import CACHE_VARIABLE, cache_directory, find_compiler


@pytest.fixture(params=sorted(SCENES))
def ordinary_scene(request: pytest.FixtureRequest) -> Measurements:
    """One ordinary situation after the other."""
    return SCENES[request.param]


@pytest.fixture
def compiler() -> tuple[str, ...]:
    """Command of the C compiler."""
    found = find_compiler()
    if found is None:
        pytest.skip("no C compiler on this machine")
    return found


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of its own for compiled problems."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return cache_directory()


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
