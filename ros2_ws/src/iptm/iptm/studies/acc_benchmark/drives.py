"""The runs of the benchmark: strategies behind the measured lead vehicles, previews and limits of the gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from iptm.studies.acc_benchmark.scenes import Scene
from iptm.studies.drives import DEFAULT, PRODUCTION, climate, spec_of
from iptm.studies.study import Case, Label, Study
from iptm_controller.production import ProductionLikeController, ProductionSettings
from iptm_core.parameters import DEFAULT_SET, load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.settings import PreviewMode
from iptm_core.state import LeaderState
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant

SMALL_INITIAL_GAP_M = 8.0
"""Gap at standstill with a largest time headway, which does not count below it."""
SHORTEST_HEADWAY_S, LONGEST_HEADWAY_S = 0.3, 1.5
ROOM_S = 0.3
"""Time headway between the lower and the upper limit of the gap at the mean speed."""
FOLLOWED_EXACTLY = {
    "limits.min_acceleration_m_s2": -8.0,
    "limits.max_acceleration_m_s2": 12.0,
    "limits.max_jerk_m_s3": 50.0,
}
"""The real follower is not held to the limits of comfort."""


CARS: Mapping[str, float] = {DEFAULT_SET: 35.0, "bmw_i3": 25.0}
"""Temperature of the air and of the cells at the start in degC, by parameter set."""


def parameters_of(car: str, overrides: Mapping[str, float] | None = None) -> ModelParameters:
    """Return the parameters of a car in its climate, some of them replaced."""
    return load_parameters(car, {**climate(CARS[car]), **(overrides or {})}).values


@dataclass(frozen=True)
class Variant:
    """A variant of driving behind the lead vehicles.

    Attributes:
        name: for labels and tables.
        role: of the controller, one of `STRATEGIES`.
        preview: whether the lead vehicle's future is known.
        limited: whether the time headway is at most what the real follower's 95th percentile is.
    """

    name: str
    role: str
    preview: bool
    limited: bool


VARIANTS = (
    Variant("120 m, no V2X", DEFAULT, preview=False, limited=False),
    Variant("120 m, perfect preview", DEFAULT, preview=True, limited=False),
    Variant("real headway, no V2X", DEFAULT, preview=False, limited=True),
    Variant("real headway, perfect preview", DEFAULT, preview=True, limited=True),
    Variant("production strategy, no V2X", PRODUCTION, preview=False, limited=False),
)


def headway_overrides(scene: Scene, car: str) -> dict[str, float]:
    """Return gap limits with no larger time headway than the real follower's 95th percentile.

    Where the lower limit would be above the upper one at the mean speed, its time headway is cut.
    """
    largest_s = scene.largest_headway_s
    standstill_m = load_parameters(car).values.gap.standstill_gap_m
    room_s = largest_s - standstill_m / scene.mean_speed_m_s - ROOM_S
    return {
        "gap.max_time_headway_s": round(largest_s, 2),
        "gap.time_headway_s": round(min(max(room_s, SHORTEST_HEADWAY_S), LONGEST_HEADWAY_S), 2),
        "gap.initial_gap_m": SMALL_INITIAL_GAP_M,
    }


def benchmark_study(scenes: Sequence[Scene], cars: Sequence[str], folder: Path) -> Study:
    """Return all runs; the drives of the lead vehicles are written to a folder."""
    cases = []
    for scene in scenes:
        cycle = scene.write(folder)
        for car in cars:
            for variant in VARIANTS:
                spec = spec_of(
                    cycle,
                    variant.role,
                    car,
                    CARS[car],
                    headway_overrides(scene, car) if variant.limited else None,
                    duration_s=float(scene.duration_s),
                    preview_mode=PreviewMode.FULL if variant.preview else PreviewMode.NONE,
                )
                labels: dict[str, Label] = {
                    "scene": scene.name,
                    "car": car,
                    "variant": variant.name,
                }
                cases.append(Case("/".join(map(str, labels.values())), labels, spec))
    return Study("acc_benchmark", "Behind measured lead vehicles", "", tuple(cases))


def real_follower(scene: Scene, car: str) -> Trajectory:
    """Return what the real follower's motion costs in a car, by the models of the benchmark.

    The speeds are followed exactly; the compressor, which was not measured, follows the thermostat of the
    strategy `production`.
    """
    parameters = parameters_of(car, FOLLOWED_EXACTLY)
    plant = Plant(parameters, lambda positions: 0.0 * positions)
    thermostat = ProductionLikeController(parameters, ProductionSettings())
    step = plant.observe(plant.initial_state())
    observed = []
    for second in range(scene.duration_s + 1):
        state = step.state
        leader = LeaderState(
            state.time_s,
            state.position_m + float(scene.gap_m[second]),
            float(scene.leader_speed_m_s[second]),
        )
        observed.append((step, leader))
        if second < scene.duration_s:
            acceleration = float(scene.speed_m_s[second + 1]) - state.speed_m_s
            cooling = thermostat.command(state, leader)
            command = replace(cooling, acceleration_m_s2=acceleration)
            step = plant.advance(state, command)
    return Trajectory.from_ticks(observed)
