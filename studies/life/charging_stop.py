"""Trips that end at a fast charger and warm evenings with a radiator: driven in the closed loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from studies.drives import climate, trip
from studies.life.fast_charge import (
    LIMIT_C,
    ChargingStopSettings,
    FastCharge,
    arrival_cost_eur,
    fast_charge,
)

import iptm
from iptm_controller.controller import MpcController
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.solvers.factory import SolverOptions
from iptm_controller.temperature_value import mixing_weights
from iptm_core.aging_laws.cells import AgingCell
from iptm_core.aging_laws.law import Load, Mechanism
from iptm_core.declaration import TextEnum
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes import build_route
from iptm_core.state import Command
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_life.trip_map import compressor_j
from iptm_life.year import CITY

AIR_C = (-10.0, 0.0, 5.0, 35.0)
"""Temperatures of the air on the way to the charger, and of the pack at the start."""
MINUTE_KWH = 0.1
MINUTE_VALUES_KWH = (0.05, 0.1, 0.25, 0.5, 1.0)
"""Values of a minute where that is varied."""
MINUTE_VALUES_AIR_C = 5.0
HEATER_W = 5000.0
LAST_S = 1200.0
SHORT: Mapping[str, Any] = {"duration_s": 60.0}
"""Settings of runs that only try the command."""
Overrides = Mapping[str, float]

CARS: Mapping[str, tuple[str, Overrides]] = {
    "72 kWh, 350 kJ/K": (
        "paper_calibrated",
        {
            "cell.heat_capacity_j_k": 350e3 / 3648.0,
            "cell.nominal_resistance_ohm": 0.05 * 38.0 / 96.0,
            "cell.entropic_coefficient_v_k": 0.0,
            "cooling.air_exchange_w_k": 25.0,
        },
    ),
    "tesla_model_3": ("tesla_model_3", {}),
}
"""The paper's pack with 350 kJ/K, 0.05 ohm and 25 W/K to the air (chosen), and a shipped car as it is."""

FIRST_CAR = next(iter(CARS))


class Preparation(TextEnum):
    """Treatment of the pack on the way."""

    NONE = "none"
    LAST_MINUTES = "last 20 minutes"
    OPTIMISED = "optimised"


class RuledCompressor:
    """The suite's controller, but a rule heats with full power in the last minutes, up to 30 degC."""

    def __init__(self, parameters: ModelParameters, end_s: float, solver: SolverOptions) -> None:
        options = ControllerOptions(solver=solver, trip_duration_s=end_s)
        self._inner = MpcController(parameters, options)
        self._begin_s = end_s - LAST_S

    def decide(self, measured: Measurements) -> Command:
        """Return the command of one tick."""
        command, state = self._inner.decide(measured).command, measured.state
        power_w = 0.0
        if state is not None and state.time_s >= self._begin_s:
            is_cold = state.cell_n_temperature_k < LIMIT_C[-1] + CELSIUS_ZERO_K
            power_w = -HEATER_W if is_cold else 0.0
        return replace(command, compressor_power_w=power_w)


def arrival_calls(
    cars: Sequence[str] = tuple(CARS), air_c: Sequence[float] = AIR_C, **settings: Any
) -> list[dict[str, Any]]:
    """Return the arguments of `arrival` for every car and temperature, with every preparation."""
    return [
        {"car": car, "air_c": celsius, "preparation": preparation, **settings}
        for car in cars
        for celsius in air_c
        for preparation in Preparation
    ]


def minute_calls() -> list[dict[str, Any]]:
    """Return the arguments of `arrival` for the first car with several values of a minute."""
    fixed = {"car": FIRST_CAR, "air_c": MINUTE_VALUES_AIR_C, "preparation": Preparation.OPTIMISED}
    return [{**fixed, "minute_kwh": minute_kwh} for minute_kwh in MINUTE_VALUES_KWH]


def arrival(
    car: str,
    air_c: float,
    preparation: Preparation,
    minute_kwh: float = MINUTE_KWH,
    **settings: Any,
) -> dict[str, Any]:
    """Drive to the charger.

    Args:
        car: name in `CARS`.
        air_c: temperature of the air, and of the pack at the start.
        preparation: what is done on the way.
        minute_kwh: value of a minute where it is optimised.
        settings: of the trip, as in `iptm.simulate`.

    Returns:
        ``car``, ``air_c``, ``preparation``; ``arrival_c``, the mean temperature of the pack on arrival;
        ``battery_kwh`` from the pack; ``minute_kwh``, value of a minute in the optimisation, 0 without;
        ``charge`` by the pack's own heat, and ``heated``, the same with the heater on the charger.
    """
    value_kwh = minute_kwh if preparation is Preparation.OPTIMISED else 0.0
    heater = {} if preparation is Preparation.NONE else {"limits.max_heater_power_w": HEATER_W}
    run = _drive(
        car,
        {**heater, **climate(air_c)},
        heats_at_last=preparation is Preparation.LAST_MINUTES,
        minute_kwh=value_kwh,
        **settings,
    )
    arrived_k = arrival_k(run)
    stop = ChargingStopSettings(charging_minute_kwh=value_kwh)
    own_heat, heated = (
        fast_charge(
            np.array([arrived_k]), replace(stop, charging_heater_kw=kilowatt), run.parameters
        )
        for kilowatt in (0.0, 1e-3 * HEATER_W)
    )
    return {
        "car": car,
        "air_c": air_c,
        "preparation": preparation,
        "arrival_c": arrived_k - CELSIUS_ZERO_K,
        "battery_kwh": run.metrics.battery_energy_j / J_PER_KWH,
        "minute_kwh": value_kwh,
        "charge": own_heat,
        "heated": heated,
    }


EVENINGS = {"Phoenix, October": (38.0, 27.0), "Rome, July": (34.0, 24.0)}
"""Temperatures of pack and air, degC: chosen, a pack after a day in the sun, in the air of the evening."""
RADIATOR: Overrides = {"cooling.radiator_w_k": 150.0, "cooling.radiator_fan_power_w": 100.0}
COOLINGS: Mapping[str, Overrides] = {"chiller": {}, "chiller and radiator": RADIATOR}
EVENING_LAW = "nca"


def evening_calls(**settings: Any) -> list[dict[str, Any]]:
    """Return the arguments of `evening` for warm packs, without and with a radiator."""
    return [
        {"place": place, "cooling": cooling, **settings}
        for place in EVENINGS
        for cooling in COOLINGS
    ]


def evening(place: str, cooling: str, **settings: Any) -> dict[str, Any]:
    """Drive from a warm pack under the law of a cell.

    Args:
        place: one of `EVENINGS`.
        cooling: one of `COOLINGS`.
        settings: of the trip, as in `iptm.simulate`.

    Returns:
        ``place``, ``cooling`` (with what), ``arrival_c``, ``thermal_kwh`` of compressor, pump and fan, and
        ``removed_kwh``, heat taken from the coolant.
    """
    pack_c, air_c = EVENINGS[place]
    start = {"environment.initial_cell_temperature_k": pack_c + CELSIUS_ZERO_K}
    own = {**COOLINGS[cooling], **climate(air_c), **start}
    run = _drive(FIRST_CAR, own, aging_law=EVENING_LAW, **settings)
    removed_j = np.dot(run.trajectory.chiller_heat_w[1:], run.trajectory.intervals_s)
    return {
        "place": place,
        "cooling": cooling,
        "arrival_c": arrival_k(run) - CELSIUS_ZERO_K,
        "thermal_kwh": compressor_j(run.trajectory) / J_PER_KWH,
        "removed_kwh": float(removed_j) / J_PER_KWH,
    }


def charging_damage(cell: AgingCell, charge: FastCharge) -> float:
    """Return the cyclic damage of a charge from one temperature, summed over the mechanisms."""
    hours = float(np.sum(charge.step_s)) / 3600.0
    mean_1_h = float(np.sum(charge.c_rate_1_h * charge.step_s)) / 3600.0 / hours
    load = Load(
        charge.temperature_k[:, 0],
        -charge.c_rate_1_h[:, 0],
        charge.charge,
        float(np.ptp(charge.charge)),
        mean_1_h,
        mean_1_h,
    )
    return sum(
        float(np.sum(part.damage_rate_1_s(load) * charge.step_s[:, 0]))
        for part in cell.law.mechanisms
        if part.mechanism is Mechanism.CYCLIC
    )


def _drive(
    car: str,
    overrides: Overrides,
    *,
    heats_at_last: bool = False,
    minute_kwh: float = 0.0,
    **settings: Any,
) -> iptm.Run:
    parameter_set, of_the_car = CARS[car]
    changes = {**of_the_car, **overrides}
    call = trip(CITY, car=parameter_set, overrides=changes, **settings)
    if heats_at_last:
        parameters = load_parameters(parameter_set, changes).values
        gap_m, duration_s = parameters.gap.initial_gap_m, settings.get("duration_s")
        end_s = build_route(CITY, initial_gap_m=gap_m, duration_s=duration_s).duration_s
        call["controller"] = RuledCompressor(parameters, end_s, SolverOptions())
    if minute_kwh:
        stop = ChargingStopSettings(charging_minute_kwh=minute_kwh)
        call["arrival_cost_eur"] = arrival_cost_eur(stop, iptm.Trip.of(**call).parameters)
    return iptm.simulate(**call)


def arrival_k(run: iptm.Run) -> float:
    """Return the mean temperature to which the coolant mixes the cells on arrival."""
    end = run.trajectory.cell_1_temperature_k[-1], run.trajectory.cell_n_temperature_k[-1]
    share_1, share_n, _ = mixing_weights(run.parameters)
    return float(share_1 * end[0] + share_n * end[1])
