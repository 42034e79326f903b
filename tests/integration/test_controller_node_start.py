"""Starts of the controller that cannot succeed: one clear line and an exit code."""

from __future__ import annotations

import sys
from typing import Any

import pytest

from iptm_controller.ocp.compilation import find_compiler

MODULE = "iptm_controller.node"


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"horizon": "3by1"}, "horizon '3by1' cannot be read"),
        ({"strategy": "ageing"}, "strategy"),
        ({"max_iterations": 0}, "max_iterations"),
        ({"tolerance": ".nan"}, "tolerance"),
        ({"strategy": "aging", "aging_weight": 0.0}, "every weight is zero"),
        ({"parameter_set": "no_such_set"}, "no_such_set"),
        ({"parameter_overrides": "body.mass_kg=heavy"}, "body.mass_kg=heavy"),
        ({"horizn": "3x1"}, "did you mean 'horizon'?"),
    ],
)
def test_user_mistake_is_one_line_and_exit_code_2(
    launcher: Any, parameters: dict[str, object], expected: str
) -> None:
    process = launcher.start_node(MODULE, parameters=parameters)
    assert process.wait() == 2
    lines = process.stderr.strip().splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("iptm_controller: ")
    assert expected in lines[0]


@pytest.mark.skipif(find_compiler() is None, reason="no C compiler on this machine")
def test_a_cache_that_cannot_be_written_is_one_line_too(launcher: Any) -> None:
    (launcher.directory / "file").write_text("in the way")
    cache = launcher.directory / "file" / "cache"
    process = launcher.start("controller", sys.executable, "-m", MODULE, IPTM_CACHE_DIR=str(cache))
    assert process.wait() == 2
    assert f"compiler cache '{cache}' cannot be written" in process.stderr.splitlines()[-1]
    assert "Traceback" not in process.stderr


def test_help_names_every_parameter_and_starts_nothing(launcher: Any) -> None:
    process = launcher.start("controller", sys.executable, "-m", MODULE, "--help")
    assert process.wait() == 0
    for name in ("strategy", "horizon", "solver", "deadline_ms", "input_timeout_s"):
        assert f"  {name} (default: " in process.stdout
    assert process.stderr == ""
