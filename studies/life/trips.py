"""The closed-loop trips behind the years: cycles and controls, each from several temperatures of the pack."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

import pandas as pd
from studies.drives import DEFAULT, REFERENCE, trip
from studies.road_space import run as road_space
from studies.savings import BASELINE, PREVIEWS, PRODUCTION, road_taken
from studies.session import Case

from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.parameters import load_parameters
from iptm_core.trajectory import Trajectory
from iptm_core.units import CELSIUS_ZERO_K
from iptm_life.trip_map import START_C, TripMap, nominal_energy_j, trip_map
from iptm_life.year import CITY, MOTORWAY, NO_COOLING

THERMOSTAT, EQUAL_ROAD = "thermostat", "default, 2 s"


@dataclass(frozen=True)
class Control:
    """A control of trips.

    Attributes:
        role: of the controller.
        distance: for tables.
        overrides: further parameters.
        value_beyond_trip: whether a kelvin keeps its value beyond the trip.
    """

    role: str
    distance: str
    overrides: Mapping[str, float] = field(default_factory=dict)
    value_beyond_trip: bool = False


CONTROLS: Mapping[str, Control] = {
    THERMOSTAT: Control(PRODUCTION, "1.6 s"),
    NO_COOLING: Control(PRODUCTION, "1.6 s", {"limits.max_compressor_power_w": 1.0}),
    BASELINE: Control(BASELINE, "3.5 s"),
    REFERENCE: Control(REFERENCE, "120 m"),
    EQUAL_ROAD: Control(
        DEFAULT, road_space.EQUAL_ROAD, road_space.EQUAL["overrides"], value_beyond_trip=True
    ),
    DEFAULT: Control(DEFAULT, "120 m"),
}
"""The first is the one with which all others are compared."""
DRIVEN_CONTROLS = tuple(CONTROLS)


def trip_case(
    cycle: str,
    control: str,
    start_c: float,
    aging: AgingSettings | None = None,
    name: str = "",
) -> Case:
    """Return a trip under a control, of the default with another ageing law under a name of its own."""
    driven = CONTROLS[control]
    start = {"environment.initial_cell_temperature_k": start_c + CELSIUS_ZERO_K}
    settings = {**asdict(aging or AgingSettings()), "value_beyond_trip": driven.value_beyond_trip}
    call = trip(cycle, driven.role, overrides={**driven.overrides, **start}, **settings)
    control = name or control
    labels = {"cycle": cycle, "control": control, "start_c": start_c}
    return Case(f"{Path(cycle).stem}_{control}_{start_c:g}", labels, call)


def trip_cases(start_c: Sequence[float] = START_C) -> list[Case]:
    """Return the trips of all cycles, controls and temperatures, of which years of use are composed."""
    return [
        trip_case(cycle, control, celsius)
        for cycle in (CITY, MOTORWAY)
        for control in CONTROLS
        for celsius in start_c
    ]


def trajectories(driven: pd.DataFrame) -> Mapping[tuple[str, str], Sequence[Trajectory]]:
    """Return what was driven by cycle and control."""
    runs: dict[tuple[str, str], list[Trajectory]] = {}
    for row in driven.itertuples():
        runs.setdefault((row.cycle, row.control), []).append(row.run.trajectory)
    return runs


def trip_maps(driven: pd.DataFrame) -> Mapping[tuple[str, str], TripMap]:
    """Return the trips by cycle and control."""
    energy_j = nominal_energy_j(load_parameters().values)
    return {label: trip_map(runs, energy_j) for label, runs in trajectories(driven).items()}


def roads(driven: pd.DataFrame) -> pd.DataFrame:
    """Return a row per cycle and control: distance, preview, and the road that it takes."""
    return pd.DataFrame(
        {
            "cycle": cycle,
            "control": control,
            "distance": CONTROLS[control].distance,
            "preview": PREVIEWS[CONTROLS[control].role in (DEFAULT, REFERENCE)],
            **road_taken(runs),
        }
        for (cycle, control), runs in trajectories(driven).items()
        if control in CONTROLS
    )
