"""Specifications: checked, canonical, and readable again."""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm.studies.run_spec import RunKind, RunSpec, canonical_json
from iptm.studies.study import planned_run
from iptm_controller.strategy import STRATEGIES
from iptm_core.errors import IptmError, ScenarioError
from iptm_core.settings import PreviewMode, PreviewSettings

VARIED = RunSpec(
    kind=RunKind.WHOLE_TRIP,
    cycle="wltc_class3b",
    slope="large",
    duration_s=12.0,
    parameter_set="textbook_cell",
    overrides=(("gap.max_gap_m", 80.0), ("body.mass_kg", 1500.0)),
    strategy=STRATEGIES["energy_aging"],
    horizon="3x1+5x5",
    solver="ipopt",
    tolerance=1e-6,
    max_iterations=99,
    noise_std_m_s=1.0,
    latency_s=2.0,
    seed=7,
    tick_s=0.5,
    plant_step_s=0.1,
    charging_minute_kwh=0.25,
    fast_charge_from=0.2,
)


@pytest.mark.parametrize("spec", [RunSpec(), VARIED])
def test_json_gives_the_specification_back(spec: RunSpec) -> None:
    assert RunSpec.from_dict(json.loads(canonical_json(spec.to_dict()))) == spec


def test_equal_runs_have_equal_text() -> None:
    swapped = replace(VARIED, overrides=VARIED.overrides[::-1], horizon="3 x 1.0 s + 5x5")
    assert swapped == VARIED
    assert canonical_json(swapped.to_dict()) == canonical_json(VARIED.to_dict())


@pytest.mark.parametrize(
    ("build", "complaint"),
    [
        (lambda: RunSpec(horizon="3x5+5x1"), "do not shrink"),
        (lambda: RunSpec(plant_step_s=-1.0), "plant_step_s is -1"),
        (lambda: RunSpec(duration_s=float("inf")), "duration_s is inf"),
        (lambda: RunSpec(slope="steep"), "slope is 'steep'.* as_designed"),
        (lambda: RunSpec(preview_step_s=90.0), "preview_step_s is 90"),
        (lambda: RunSpec(solver="simplex"), "solver is 'simplex'.*; allowed: one of riccati, "),
        (lambda: RunSpec(tolerance=0.0), "tolerance is 0.0 .*; allowed: "),
        (lambda: RunSpec(dropout_probability=1.5), "dropout_probability is 1.5 .* 0 to 1"),
        (lambda: RunSpec(preview_length_s=0.5), "preview_length_s is 0.5 .* 1 to 3600"),
    ],
)
def test_bad_values_are_refused(build: Callable[[], object], complaint: str) -> None:
    with pytest.raises(IptmError, match=complaint):
        build()


@pytest.mark.parametrize(
    "content",
    [
        {},
        {**RunSpec().to_dict(), "colour": "red"},
        {**RunSpec().to_dict(), "kind": "half_trip"},
        {**RunSpec().to_dict(), "overrides": 5},
        {**RunSpec().to_dict(), "solver": {"brand": "x"}},
    ],
)
def test_foreign_content_is_refused(content: dict[str, Any]) -> None:
    with pytest.raises(ScenarioError, match="cannot be read"):
        RunSpec.from_dict(content)


def test_preview_covers_the_horizon_and_its_own_age() -> None:
    assert RunSpec().bridge_settings() == PreviewSettings()
    late = RunSpec(horizon="3x1+12x15", latency_s=4.0)
    assert late.bridge_settings().preview_length_s == 217.0
    assert replace(late, preview_length_s=20.0).bridge_settings().preview_length_s == 20.0
    settings = RunSpec(horizon="3x1+12x15", preview_mode=PreviewMode.NONE).bridge_settings()
    assert settings.preview_mode is PreviewMode.NONE
    assert settings.preview_length_s == 213.0


def test_description_names_what_is_unusual() -> None:
    assert RunSpec().describe() == "comprehensive, 15x1, aging"
    text = VARIED.describe()
    for part in ("12 s", "whole trip", "textbook_cell", "gap.max_gap_m=80", "latency_s=2.0"):
        assert part in text


STOP = Fault(FaultKind.LEADER_HARD_STOP, 30.0, 10.0)
LOST = Fault(FaultKind.PREVIEW_LOST, 10.0, 10.0)


def test_faults_are_part_of_a_specification_and_of_its_key() -> None:
    sound, faulty = RunSpec(duration_s=60.0), RunSpec(duration_s=60.0, faults=(STOP, LOST))
    assert faulty.faults == (LOST, STOP)
    assert RunSpec.from_dict(faulty.to_dict()) == faulty
    assert planned_run(sound).key != planned_run(faulty).key
    assert "leader_hard_stop 8 m/s^2 at 30 s for 10 s" in faulty.describe()
    with pytest.raises(ScenarioError, match="clock_jump"):
        RunSpec(faults=(Fault(FaultKind.CLOCK_JUMP),))


def test_a_whole_trip_has_something_to_optimise() -> None:
    with pytest.raises(ScenarioError, match="'production', which optimises nothing"):
        RunSpec(kind=RunKind.WHOLE_TRIP, strategy=STRATEGIES["production"])
