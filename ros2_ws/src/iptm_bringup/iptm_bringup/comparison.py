"""The same trip under another strategy, driven without ROS, to tell what a run is worth."""

from __future__ import annotations

from dataclasses import dataclass, fields

from iptm_bringup.scenario import PreparedScenario
from iptm_controller.controller import Controller, ControllerOptions
from iptm_controller.horizon import SINGLE_HORIZON
from iptm_controller.strategy import strategy_by_name
from iptm_core.metrics import RunMetrics, compute_metrics, figure_values
from iptm_core.settings import PreviewSettings
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import run_closed_loop

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
        life = -100.0 * changes["total_degradation"]
        said = "saved" if life >= 0.0 else "lost"
        return (
            f"against the {self.strategy}: {abs(life):.1f} % of battery aging {said}, cooling energy "
            f"{100.0 * changes['cooling_energy']:+.1f} %, traction energy "
            f"{100.0 * changes['traction_energy']:+.1f} %"
        )


def drive_comparison(prepared: PreparedScenario, strategy: str) -> Comparison:
    """Drive the trip of a scenario once more.

    Args:
        prepared: leader, road, vehicle and preview of the run.
        strategy: name of the other strategy.

    Raises:
        IptmError: the strategy is not known, or the problem cannot be compiled.
    """
    scenario, model, route = prepared.scenario, prepared.model.values, prepared.route
    options = ControllerOptions(
        strategy=strategy_by_name(strategy),
        horizon=SINGLE_HORIZON,
        trip_duration_s=route.duration_s,
    )
    preview = PreviewSettings(
        **{entry.name: getattr(scenario, entry.name) for entry in fields(PreviewSettings)}
    )
    plant = Plant(model, route.slope.slope_at)
    run = run_closed_loop(route, plant, Controller(model, options), preview)
    return Comparison(strategy, compute_metrics(run.trajectory, model, run.decisions))
