"""Trips that end at a fast charger and warm evenings with a radiator: driven in the closed loop."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_controller.temperature_value import mixing_weights
from iptm_core.aging_laws.cells import AgingCell
from iptm_core.aging_laws.law import Load, Mechanism
from iptm_core.charging_stop import LIMIT_C, ChargingStopSettings, FastCharge, fast_charge
from iptm_core.declaration import TextEnum
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_studies.life.trips import CITY
from iptm_studies.run import Run, controller_options, perform_run
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.run_spec import RunSpec, SolverSpec

AIR_C = (-10.0, 0.0, 5.0, 35.0)
MINUTE_KWH = 0.1
WORTHS_KWH = (0.05, 0.1, 0.25, 0.5, 1.0)
WORTHS_AIR_C = 5.0
HEATER_W = 5000.0
LAST_S = 1200.0
_J_PER_KWH = 3.6e6
_OWN = ControllerSettings()
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
    """What is done with the pack on the way."""

    NONE = "none"
    LAST_MINUTES = "last 20 minutes"
    OPTIMISED = "optimised"


class LastMinutes:
    """The suite's controller, but its heater runs at full power from some time before the end, up to 30 degC.

    Attributes:
        options: those of the controller.
    """

    def __init__(self, controller: Controller, from_s: float) -> None:
        self.options: ControllerOptions = controller.options
        self._controller = controller
        self._from_s = from_s

    def decide(self, measured: Measurements) -> Decision:
        """Decide one tick."""
        decision = self._controller.decide(measured)
        state = measured.state
        heats = (
            state is not None
            and state.time_s >= self._from_s
            and state.cell_n_temperature_k < LIMIT_C[-1] + CELSIUS_ZERO_K
        )
        power_w = -HEATER_W if heats else 0.0
        return replace(decision, command=replace(decision.command, compressor_power_w=power_w))


@dataclass(frozen=True)
class Arrival:
    """A trip that ended at the charger.

    Attributes:
        car: name in `CARS`.
        air_c: temperature of air, and of the pack at the start.
        preparation: what was done on the way.
        arrival_c: mean temperature of the pack on arrival.
        battery_kwh: energy from the pack.
        minute_kwh: what a minute is worth to the optimisation, 0 without.
        charge: charging by the pack's own heat.
        heated: the same with the heater on the charger.
    """

    car: str
    air_c: float
    preparation: Preparation
    arrival_c: float
    battery_kwh: float
    minute_kwh: float
    charge: FastCharge
    heated: FastCharge


@dataclass(frozen=True)
class Extent:
    """How much is driven.

    Attributes:
        duration_s: where trips are cut, None for their ends.
        compile_code: whether controllers are compiled.
        air_c: temperatures of the air on the way to the charger.
        cars: names in `CARS`.
        worths_kwh: what a minute is worth, where that is varied.
    """

    duration_s: float | None = None
    compile_code: bool = True
    air_c: tuple[float, ...] = AIR_C
    cars: tuple[str, ...] = tuple(CARS)
    worths_kwh: tuple[float, ...] = WORTHS_KWH


SHORT = Extent(60.0, compile_code=False, air_c=(WORTHS_AIR_C,), cars=(FIRST_CAR,), worths_kwh=())


def arrivals(extent: Extent, minute_kwh: float = MINUTE_KWH) -> Iterator[Arrival]:
    """Drive to the charger from every temperature, with every preparation."""
    for car in extent.cars:
        for air_c in extent.air_c:
            for preparation in Preparation:
                yield arrival(car, air_c, preparation, extent, minute_kwh)


def worths(extent: Extent) -> Iterator[Arrival]:
    """Drive the first car with minutes of different worth."""
    for minute_kwh in extent.worths_kwh:
        yield arrival(FIRST_CAR, WORTHS_AIR_C, Preparation.OPTIMISED, extent, minute_kwh)


def arrival(
    car: str, air_c: float, preparation: Preparation, extent: Extent, minute_kwh: float
) -> Arrival:
    """Drive to the charger.

    Args:
        car: name in `CARS`.
        air_c: temperature of the air, and of the pack at the start.
        preparation: what is done on the way.
        extent: how much is driven.
        minute_kwh: what a minute is worth where it is optimised.
    """
    parameter_set, overrides = CARS[car]
    own = dict(overrides)
    if preparation is not Preparation.NONE:
        own["limits.max_heater_power_w"] = HEATER_W
    for name in ("ambient_temperature_k", "initial_cell_temperature_k"):
        own[f"environment.{name}"] = air_c + CELSIUS_ZERO_K
    worth = minute_kwh if preparation is Preparation.OPTIMISED else 0.0
    spec = _spec(parameter_set, own, extent, charging_minute_kwh=worth)
    run = _drive(spec, heats_at_last=preparation is Preparation.LAST_MINUTES)
    arrival_k = _arrival_k(run)
    stop = ChargingStopSettings.of(spec)
    own_heat, heated = (
        fast_charge(
            np.array([arrival_k]), replace(stop, charging_heater_kw=kilowatt), run.parameters
        )
        for kilowatt in (0.0, 1e-3 * HEATER_W)
    )
    battery_kwh = run.metrics.battery_energy_j / _J_PER_KWH
    arrival_c = arrival_k - CELSIUS_ZERO_K
    return Arrival(car, air_c, preparation, arrival_c, battery_kwh, worth, own_heat, heated)


EVENINGS = {"Phoenix, October": (38.0, 27.0), "Rome, July": (34.0, 24.0)}
"""Temperatures of pack and air, degC: chosen, a pack after a day in the sun, in the air of the evening."""
RADIATOR: Overrides = {"cooling.radiator_w_k": 150.0, "cooling.radiator_fan_power_w": 100.0}
EVENING_LAW = "nca"


def evenings(extent: Extent) -> Iterator[dict[str, Any]]:
    """Drive from warm packs under the law of a cell, without and with a radiator.

    Yields:
        ``place``, ``cooling`` (with what), ``arrival_c``, ``thermal_kwh`` of compressor, pump and fan, and
        ``removed_kwh``, heat taken from the coolant.
    """
    parameter_set, overrides = CARS[FIRST_CAR]
    for place, (pack_c, air_c) in EVENINGS.items():
        for cooling, radiator in (("chiller", {}), ("chiller and radiator", RADIATOR)):
            own = {
                **overrides,
                **radiator,
                "environment.ambient_temperature_k": air_c + CELSIUS_ZERO_K,
                "environment.initial_cell_temperature_k": pack_c + CELSIUS_ZERO_K,
            }
            run = _drive(_spec(parameter_set, own, extent, aging_law=EVENING_LAW))
            spent_j, removed_j = (
                float(np.dot(power_w[1:], run.trajectory.intervals_s))
                for power_w in (run.trajectory.compressor_power_w, run.trajectory.chiller_heat_w)
            )
            yield {
                "place": place,
                "cooling": cooling,
                "arrival_c": _arrival_k(run) - CELSIUS_ZERO_K,
                "thermal_kwh": spent_j / _J_PER_KWH,
                "removed_kwh": removed_j / _J_PER_KWH,
            }


def charging_damage(cell: AgingCell, charge: FastCharge) -> float:
    """Return the cyclic damage of a charge from one temperature, summed over the mechanisms."""
    hours = float(np.sum(charge.step_s)) / 3600.0
    mean_1_h = float(np.sum(charge.c_rate_1_h * charge.step_s)) / 3600.0 / hours
    depth = float(np.ptp(charge.charge))
    load = Load(
        charge.temperature_k[:, 0],
        -charge.c_rate_1_h[:, 0],
        charge.charge,
        depth,
        mean_1_h,
        mean_1_h,
    )
    return float(
        sum(
            np.sum(part.damage_rate_1_s(load) * charge.step_s[:, 0])
            for part in cell.law.mechanisms
            if part.mechanism is Mechanism.CYCLIC
        )
    )


def _spec(parameter_set: str, overrides: Overrides, extent: Extent, **more: object) -> RunSpec:
    return RunSpec(
        cycle=CITY,
        duration_s=extent.duration_s,
        parameter_set=parameter_set,
        overrides=tuple(overrides.items()),
        strategy=strategy_by_name(_OWN.strategy),
        horizon=_OWN.horizon,
        solver=SolverSpec(compile_code=extent.compile_code),
        **more,  # type: ignore[arg-type]
    )


def _drive(spec: RunSpec, *, heats_at_last: bool = False) -> Run:
    inputs = resolve_inputs(spec)
    own = None
    if heats_at_last:
        end_s = inputs.route.duration_s
        controller = Controller(inputs.parameters, controller_options(spec, end_s))
        own = LastMinutes(controller, end_s - LAST_S)
    return perform_run(inputs, own_controller=own)


def _arrival_k(run: Run) -> float:
    """Return the mean temperature to which the coolant mixes the cells on arrival."""
    end = run.trajectory.cell_1_temperature_k[-1], run.trajectory.cell_n_temperature_k[-1]
    share_1, share_n, _ = mixing_weights(run.parameters)
    return float(share_1 * end[0] + share_n * end[1])
