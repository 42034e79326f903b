"""The same trip under another strategy, driven without ROS, to compare a run with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from iptm.closed_loop import ClosedLoopRun, run_closed_loop
from iptm.run import Run
from iptm.runner.scenario import Scenario
from iptm.studies.run_spec import HEADLESS_LEADERS
from iptm_controller.controller import Controller
from iptm_controller.horizon import SINGLE_HORIZON, Horizon
from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import strategy_by_name
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.declaration import given_settings
from iptm_core.road_ahead import RoadAheadSettings
from iptm_core.settings import (
    IntegrationSettings,
    PreviewSettings,
    SafetyMonitorSettings,
    SamplingSettings,
)
from iptm_core.state import LeaderState
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep
from iptm_ros.topics import PLANT
from iptm_v2x_bridge.bridge import PreviewSource, TickBridge
from iptm_v2x_bridge.rules_of_the_road import road_bridge

NO_COMPARISON = "none"


def drive_other(
    scenario: Scenario,
    strategy: str,
    on_step: Callable[[PlantStep, LeaderState | None], None] | None = None,
) -> ClosedLoopRun:
    """Drive the trip of a scenario with its plant by another strategy, on the paper's single horizon.

    Raises:
        IptmError: the strategy is not known, or the problem cannot be compiled.
    """
    source, bridge = bridge_for(scenario)
    return run_closed_loop(
        scenario.trip,
        plant_for(scenario),
        controller_for(scenario, strategy),
        bridge=bridge,
        leader=source,
        on_step=on_step,
    )


def plant_for(scenario: Scenario) -> Plant:
    """Return the plant that a scenario asks for."""
    of_plant = scenario.node_parameters.get(PLANT, {})
    integration = given_settings(IntegrationSettings, of_plant)
    return Plant(
        scenario.vehicle.values,
        scenario.trip.slope.slope_at,
        integration.integration_step_s,
        integration.thermal_model,
        given_settings(SafetyMonitorSettings, {**vars(scenario), **of_plant}),
    )


def controller_for(
    scenario: Scenario, strategy: str, horizon: Horizon = SINGLE_HORIZON
) -> Controller:
    """Return a fresh controller with a strategy and a horizon, the paper's single one, for a scenario."""
    of_plant = scenario.node_parameters.get(PLANT, {})
    options = ControllerOptions(
        strategy=strategy_by_name(strategy),
        horizon=horizon,
        tick_s=given_settings(SamplingSettings, of_plant).period_s,
        trip_duration_s=scenario.trip.duration_s,
        aging=given_settings(AgingSettings, vars(scenario)),
    )
    return Controller(scenario.vehicle.values, options)


def bridge_for(scenario: Scenario) -> tuple[PreviewSource, TickBridge]:
    """Return the leader of a scenario without ROS and its bridge; one that is heard drives the cycle."""
    road = scenario.road
    if road.leader_source not in HEADLESS_LEADERS:
        road = RoadAheadSettings()
    preview = PreviewSettings.of(scenario)
    return road_bridge(road, scenario.trip, scenario.vehicle.values, preview)


def drive_comparison(scenario: Scenario, strategy: str) -> Run:
    """Return the run of another strategy on the trip of a scenario; see `drive_other`."""
    return headless_run(scenario, strategy, drive_other(scenario, strategy))


def headless_run(scenario: Scenario, strategy: str, done: ClosedLoopRun) -> Run:
    """Return what was driven without ROS with the vehicle and the road of a scenario."""
    model, slope = scenario.vehicle.values, scenario.trip.slope
    settings = {"strategy": strategy}
    return Run(strategy, settings, model, done.trajectory, done.decisions, slope)


def save_comparison(path: Path, other: Run, heading: str) -> None:
    """Write the trajectory of a run as a Parquet file with the columns of an exported run.

    Raises:
        BagError: the file cannot be written.
    """
    # Loaded only now: it takes time that the nodes can use better.
    from iptm_ros.recording.export import (  # noqa: PLC0415
        export_table,
        trajectory_columns,
        write_parquet,
    )

    texts = {"table": "trajectory", "strategy": other.strategy, "compared_with": heading}
    write_parquet(path, export_table(trajectory_columns(other.trajectory), texts))
