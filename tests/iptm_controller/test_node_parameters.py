"""From the parameters of the node to a controller."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from tests.iptm_controller.scenes import PARAMETERS

from iptm_controller.horizon import MULTI_HORIZON, Horizon
from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import DEFAULT_STRATEGY, STRATEGIES
from iptm_core.errors import ParameterError

SMALL = ControllerNodeParameters(horizon="2x1", compile_code=False)


def test_defaults_of_the_node_are_those_of_the_controller() -> None:
    options = replace(SMALL, horizon=str(MULTI_HORIZON)).build_controller().options
    expected = ControllerOptions()
    assert options.strategy == expected.strategy == STRATEGIES[DEFAULT_STRATEGY]
    assert options.horizon == expected.horizon == MULTI_HORIZON
    assert options.shifted_plan_ticks == expected.shifted_plan_ticks
    assert options.safe_law_ticks == expected.safe_law_ticks
    assert options.max_preview_age_s == expected.max_preview_age_s
    assert options.tick_s == expected.tick_s
    assert replace(options.solver, compile_code=True) == expected.solver


def test_every_parameter_reaches_the_controller() -> None:
    controller = ControllerNodeParameters(
        strategy="reference",
        horizon="2x1+1x5",
        solver="ipopt",
        compile_code=False,
        max_iterations=42,
        deadline_ms=80.0,
        tolerance=1e-4,
        parameter_overrides="gap.max_gap_m=80, limits.max_jerk_m_s3=1.0",
        period_s=0.5,
        max_preview_age_s=3.0,
        shifted_plan_ticks=7,
        safe_law_ticks=9,
    ).build_controller()
    options = controller.options
    assert options.strategy == STRATEGIES["reference"]
    assert options.horizon == Horizon.parse("2x1+1x5")
    assert (options.solver.name, options.solver.compile_code) == ("ipopt", False)
    assert options.solver.max_iterations == 42
    assert options.solver.deadline_s == pytest.approx(0.08)
    assert options.solver.tolerance == 1e-4
    assert (options.shifted_plan_ticks, options.safe_law_ticks) == (7, 9)
    assert options.max_preview_age_s == 3.0
    assert options.tick_s == 0.5
    assert controller.backend.name == "ipopt"
    assert PARAMETERS.gap.max_gap_m != 80.0


def test_all_weights_zero_is_refused() -> None:
    with pytest.raises(ParameterError, match="every weight is zero"):
        replace(SMALL, aging_weight=0.0).build_controller()


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"horizon": "3by1"}, "horizon '3by1' cannot be read"),
        ({"horizon": "5x5+3x1"}, "do not shrink"),
        ({"parameter_set": "no_such_set"}, "no_such_set"),
        ({"parameter_overrides": "body.mas_kg=1600"}, "mas_kg"),
        ({"parameter_overrides": "body.mass_kg=-1"}, "mass_kg"),
        ({"parameter_overrides": "body.mass_kg"}, "overrides have the entry"),
    ],
)
def test_what_cannot_be_built_is_named(wrong: dict[str, Any], complaint: str) -> None:
    with pytest.raises(ParameterError) as caught:
        replace(SMALL, **wrong).build_controller()
    assert complaint in str(caught.value)
