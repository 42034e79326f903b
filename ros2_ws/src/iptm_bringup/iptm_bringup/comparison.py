"""The same trip under another strategy, driven without ROS, to compare a run with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from iptm_bringup.scenario import PreparedScenario
from iptm_controller.controller import Controller
from iptm_controller.horizon import SINGLE_HORIZON, Horizon
from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import strategy_by_name
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.declaration import given_settings
from iptm_core.metrics import RunMetrics, compute_metrics, figure_values
from iptm_core.road_ahead import RoadAheadSettings
from iptm_core.settings import (
    IntegrationSettings,
    PreviewSettings,
    SafetyMonitorSettings,
    SamplingSettings,
)
from iptm_core.state import LeaderState
from iptm_core.trajectory import Trajectory
from iptm_interfaces.topics import PLANT
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep
from iptm_studies.closed_loop import ClosedLoopRun, run_closed_loop
from iptm_studies.run_spec import HEADLESS_LEADERS
from iptm_v2x_bridge.bridge import PreviewSource, TickBridge
from iptm_v2x_bridge.road_knowledge import road_bridge

NO_COMPARISON = "none"


@dataclass(frozen=True, eq=False)
class Comparison:
    """What another strategy achieves on the trip of a run.

    Attributes:
        strategy: its name; it plans on the paper's single horizon.
        metrics: its figures.
        trajectory: what happened.
    """

    strategy: str
    metrics: RunMetrics
    trajectory: Trajectory

    def changes(self, metrics: RunMetrics) -> dict[str, float]:
        """Return the relative change of every figure of a run against this one, as fractions."""
        return relative_changes(metrics, self.metrics)

    def save(self, path: Path, heading: str) -> None:
        """Write the trajectory as a Parquet file with the columns of an exported run.

        Args:
            path: new file.
            heading: of the run that this one is compared with.

        Raises:
            BagError: the file cannot be written.
        """
        # Loaded only now: it takes time that the nodes can use better.
        from iptm_recording.export import (  # noqa: PLC0415
            ExportTable,
            trajectory_columns,
            write_parquet,
        )

        texts = {"table": "trajectory", "strategy": self.strategy, "compared_with": heading}
        write_parquet(path, ExportTable(trajectory_columns(self.trajectory), texts))


def relative_changes(own: RunMetrics, other: RunMetrics) -> dict[str, float]:
    """Return the relative change of every figure of a run against another one, as fractions."""
    others = figure_values(other)
    return {
        key: value / others[key] - 1.0
        for key, value in figure_values(own).items()
        if others.get(key, 0.0)
    }


def drive_other(
    prepared: PreparedScenario,
    strategy: str,
    on_step: Callable[[PlantStep, LeaderState | None], None] | None = None,
) -> ClosedLoopRun:
    """Drive the trip of a scenario once more, with the plant and the sampling time that it asks for.

    Args:
        prepared: leader, road, vehicle and preview of the run.
        strategy: name of the other strategy; it plans on the paper's single horizon.
        on_step: called with every row, see `run_closed_loop`.

    Raises:
        IptmError: the strategy is not known, or the problem cannot be compiled.
    """
    source, bridge = bridge_for(prepared)
    return run_closed_loop(
        prepared.route,
        plant_for(prepared),
        controller_for(prepared, strategy),
        bridge=bridge,
        leader=source,
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
        aging=given_settings(AgingSettings, vars(prepared.scenario)),
    )
    return Controller(prepared.model.values, options)


def bridge_for(prepared: PreparedScenario) -> tuple[PreviewSource, TickBridge]:
    """Return the leader of a scenario without ROS and its bridge; one that is heard drives the cycle."""
    road = prepared.road
    if road.leader_source not in HEADLESS_LEADERS:
        road = RoadAheadSettings()
    preview = PreviewSettings.of(prepared.scenario)
    return road_bridge(road, prepared.route, prepared.model.values, preview)


def drive_comparison(prepared: PreparedScenario, strategy: str) -> Comparison:
    """Return what another strategy achieves on the trip of a scenario; see `drive_other`."""
    run = drive_other(prepared, strategy)
    metrics = compute_metrics(run.trajectory, prepared.model.values, run.decisions)
    return Comparison(strategy, metrics, run.trajectory)
