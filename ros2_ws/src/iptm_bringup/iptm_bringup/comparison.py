"""The same trip under another strategy, driven without ROS, to tell what a run is worth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from iptm_bringup.scenario import PreparedScenario
from iptm_controller.controller import Controller, ControllerOptions
from iptm_controller.horizon import SINGLE_HORIZON, Horizon
from iptm_controller.strategy import strategy_by_name
from iptm_core.declaration import Settings, parameter_specs
from iptm_core.metrics import RunMetrics, compute_metrics, figure_values
from iptm_core.metrics.figures import NO_VALUE
from iptm_core.settings import (
    IntegrationSettings,
    PreviewSettings,
    SafetyMonitorSettings,
    SamplingSettings,
)
from iptm_core.state import LeaderState
from iptm_interfaces.topics import PLANT
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep
from iptm_studies.closed_loop import ClosedLoopRun, run_closed_loop

S = TypeVar("S", bound=Settings)

NO_COMPARISON = "none"


@dataclass(frozen=True)
class Comparison:
    """What another strategy achieves on the trip of a run.

    Attributes:
        strategy: its name; it plans on the paper's single horizon.
        metrics: its figures.
    """

    strategy: str
    metrics: RunMetrics

    def changes(self, metrics: RunMetrics) -> dict[str, float]:
        """Return the relative change of every figure of a run against this one, as fractions."""
        own, others = figure_values(metrics), figure_values(self.metrics)
        return {
            key: value / others[key] - 1.0 for key, value in own.items() if others.get(key, 0.0)
        }

    def headline(self, metrics: RunMetrics) -> str:
        """Say in one line what a run saves: battery life first, then energy."""
        changes = self.changes(metrics)
        texts = {key: f"{100.0 * change:+.1f} %" for key, change in changes.items()}
        life = -100.0 * changes.get("total_degradation", 0.0)
        said = "saved" if life >= 0.0 else "lost"
        # A trip at standstill takes no traction energy that another could be compared with.
        return (
            f"against the {self.strategy}: {abs(life):.1f} % of battery aging {said}, cooling energy "
            f"{texts.get('cooling_energy', NO_VALUE)}, traction energy "
            f"{texts.get('traction_energy', NO_VALUE)}"
        )


def given_settings(group: type[S], given: Mapping[str, Any]) -> S:
    """Return the settings of a group as far as they are among others; the rest are defaults."""
    names = [spec.name for spec in parameter_specs(group)]
    return group(**{name: given[name] for name in names if name in given})


def drive_other(
    prepared: PreparedScenario,
    strategy: str,
    on_step: Callable[[PlantStep, LeaderState], None] | None = None,
) -> ClosedLoopRun:
    """Drive the trip of a scenario once more, with the plant and the sampling time that it asks for.

    Args:
        prepared: leader, road, vehicle and preview of the run.
        strategy: name of the other strategy; it plans on the paper's single horizon.
        on_step: called with every row, see `run_closed_loop`.

    Raises:
        IptmError: the strategy is not known, or the problem cannot be compiled.
    """
    return run_closed_loop(
        prepared.route,
        plant_for(prepared),
        controller_for(prepared, strategy),
        preview_for(prepared),
        on_step=on_step,
    )


def plant_for(prepared: PreparedScenario) -> Plant:
    """Return the plant that a scenario asks for."""
    of_plant = prepared.scenario.node_parameters.get(PLANT, {})
    integration = given_settings(IntegrationSettings, of_plant)
    return Plant(
        prepared.model.values,
        prepared.route.slope.slope_at,
        integration.integration_step_s,
        integration.thermal_model,
        given_settings(SafetyMonitorSettings, {**vars(prepared.scenario), **of_plant}),
    )


def controller_for(
    prepared: PreparedScenario, strategy: str, horizon: Horizon = SINGLE_HORIZON
) -> Controller:
    """Return a fresh controller with a strategy and a horizon, the paper's single one, for a scenario."""
    of_plant = prepared.scenario.node_parameters.get(PLANT, {})
    options = ControllerOptions(
        strategy=strategy_by_name(strategy),
        horizon=horizon,
        tick_s=given_settings(SamplingSettings, of_plant).period_s,
        trip_duration_s=prepared.route.duration_s,
    )
    return Controller(prepared.model.values, options)


def preview_for(prepared: PreparedScenario) -> PreviewSettings:
    """Return what a scenario says about previews."""
    return given_settings(PreviewSettings, vars(prepared.scenario))


def drive_comparison(prepared: PreparedScenario, strategy: str) -> Comparison:
    """Return what another strategy achieves on the trip of a scenario; see `drive_other`."""
    run = drive_other(prepared, strategy)
    return Comparison(
        strategy, compute_metrics(run.trajectory, prepared.model.values, run.decisions)
    )
