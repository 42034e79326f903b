"""What tests share: property tests that are repeatable and do not judge by the clock; messages of a tick."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

from iptm_core.compilation import CACHE_VARIABLE, cache_directory
from iptm_core.compiler import find_compiler
from iptm_core.decision_record import DecisionRecord, Rung, SolveStatus
from iptm_core.state import (
    BatteryReading,
    IntervalPowers,
    LeaderState,
    SafetyRecord,
    VehicleState,
)
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_ros.shared_memory import remove_dead_shared_memory

# The same examples in every run, and no deadline: a busy machine must not fail a test.
settings.register_profile("iptm", deadline=None, derandomize=True)
settings.load_profile("iptm")
# Thousands of tests are collected, and all of them stay.
gc.disable()

ROOT = Path(__file__).resolve().parents[1]

ROWS = 21
"""Ticks of the made-up run."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mix files that wait for processes with files that compute: every core has work at any time.

    Files are not shared between workers: the longest ones come first, and those that wait not last.
    """
    waiting, long = "integration", ("packaging", "studies")
    items.sort(
        key=lambda item: (item.path.name != "test_studies.py", item.path.parent.name not in long)
    )
    files = list(dict.fromkeys(item.path for item in items))
    waits = [path for path in files if path.parent.name == waiting]
    computes = [path for path in files if path.parent.name != waiting]
    places = {path: place / len(computes) for place, path in enumerate(computes)}
    places |= {path: 0.85 * place / len(waits) for place, path in enumerate(waits, start=1)}
    items.sort(key=lambda item: places[item.path])
    gc.freeze()
    gc.enable()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Show how tests failed that were run once more."""
    for report in terminalreporter.stats.get("rerun", []):
        terminalreporter.section(f"failed first: {report.nodeid}")
        terminalreporter.write_line(report.longreprtext)
        for title, text in report.sections:
            terminalreporter.write_line(f"--- {title}\n{text}")


def pytest_unconfigure() -> None:
    """Remove what processes that tests have killed left in shared memory."""
    remove_dead_shared_memory()


@pytest.fixture(scope="session", autouse=True)
def usual_priority() -> Iterator[None]:
    """Keep this process from real-time priority, in which it would starve all others to its end."""

    def refuse(*_: object) -> None:
        raise PermissionError

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "sched_setscheduler", refuse)
        patch.setattr(os, "setpriority", refuse)
        yield


@pytest.fixture(scope="session", autouse=True)
def compile_cache() -> Iterator[Path]:
    """Keep compiled problems out of the user's cache; tests, their processes and later runs share them."""
    folder = ROOT / ".pytest_cache" / "compiled"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CACHE_VARIABLE, str(folder))
        yield folder


@pytest.fixture(scope="session")
def compiler() -> tuple[str, ...]:
    """Command of the C compiler."""
    return find_compiler()


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of its own for compiled problems."""
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return cache_directory()


@pytest.fixture
def tick_messages() -> Callable[[Trajectory, int], dict[Any, Any]]:
    """Return what plant and bridge publish in one row of a trajectory, by topic."""
    return _tick_messages


def _tick_messages(run: Trajectory, row: int) -> dict[Any, Any]:
    # The tests of the library run without ROS.
    from tests.plant_messages import plant_messages  # noqa: PLC0415

    from iptm_ros.codecs import encode_battery, encode_leader  # noqa: PLC0415
    from iptm_ros.topics import Topic  # noqa: PLC0415

    values = {name: float(column[row]) for name, column in run.to_arrays().items()}
    time_s = values["time_s"]
    state = VehicleState(**{name: values[name] for name in VehicleState.__dataclass_fields__})
    powers = IntervalPowers(**{name: values[name] for name in IntervalPowers.__dataclass_fields__})
    leader = LeaderState(time_s, values["leader_position_m"], values["leader_speed_m_s"])
    coolant_k = (values["coolant_inlet_temperature_k"], values["coolant_outlet_temperature_k"])
    safety = SafetyRecord(
        values["service_braking_s"],
        values["smallest_gap_m"],
        command_source=values["command_source"],
    )
    charge_ah = values["state_of_charge"] * 100.0
    battery = BatteryReading(time_s, 380.0, 10.0, (4.0,), (300.0,), charge_ah, 100.0)
    return {
        **plant_messages(state, powers, coolant_k, safety),
        Topic.PLANT_BATTERY: encode_battery(battery),
        Topic.LEADER: encode_leader(leader),
    }


@pytest.fixture
def trajectory() -> Trajectory:
    """A gentle start behind a leader; every column is different and uses all 53 bits, one row a second."""
    generator = np.random.default_rng(5)
    time_s = np.arange(ROWS, dtype=float)
    columns: dict[str, Any] = {
        name: generator.uniform(0.1, 0.2, ROWS) for name in TRAJECTORY_COLUMNS
    }
    columns["time_s"] = time_s
    columns["speed_m_s"] = 0.1 * time_s
    columns["position_m"] = 0.05 * time_s**2
    columns["acceleration_m_s2"] = 0.1 + 1e-3 * columns["acceleration_m_s2"]
    columns["leader_position_m"] = columns["position_m"] + 20.0 + columns["leader_position_m"]
    columns["command_source"] = np.zeros(ROWS)
    columns["state_of_charge"] = columns["state_of_charge"].astype(np.float32).astype(float)
    for name in TRAJECTORY_COLUMNS:
        if name.endswith("temperature_k"):
            columns[name] = (columns[name] + 26.0) + 273.15
        if name.endswith("capacity_loss"):
            columns[name] = np.sort(columns[name]) * 1e-9 + 0.002
    return Trajectory.from_arrays(columns)


@pytest.fixture
def decision_record() -> Callable[[int], DecisionRecord]:
    """Return the decision of a row: one of a fallback, one limited, the first without a preview."""
    return _decision_record


def _decision_record(row: int) -> DecisionRecord:
    return DecisionRecord(
        status=SolveStatus.SOLVED,
        solve_time_s=2e-3 + 1e-4 * row,
        iterations=10 + row,
        gap_slack_m=0.0,
        speed_slack_m_s=0.0,
        temperature_slack_k=0.0,
        objective=1.5,
        rung=Rung(row == 7),
        limiter_active=row == 3,
        preview_age_s=float("nan") if row == 0 else 0.0,
    )
