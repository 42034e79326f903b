"""Where the energy of a run went: from the open-circuit voltage of the cells to motion, heat and losses.

    open circuit = heat of the cells + terminals
    terminals    = converters + cooling + auxiliaries + consumers + motor
    motor        = motor, driveline and brakes + rolling + air + climb + motion

The first line is eq. (7): current times open-circuit voltage is current times terminal voltage and the
ohmic and entropic heat. What eq. (4) loses between terminals and motor, and what a pack that cannot be
charged leaves to the brakes, are the converters. The road load of eq. (2) is integrated in closed form
over every interval of constant acceleration. Losses of motor and driveline, and the friction brakes, are
what the motor takes beyond the road load; the brakes' part is what the wheels brake with and the motor
does not take back.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.routes.slope import SlopeProfile
from iptm_core.state import FloatArray
from iptm_core.trajectory import Trajectory


@dataclass(frozen=True)
class EnergyBalance:
    """Energies in J; NaN where the heat of the cells is not known.

    Attributes:
        open_circuit_j: current times open-circuit voltage: what the cells gave.
        cells_j: heat of the cells, ohmic and entropic.
        terminals_j: current times terminal voltage.
        converters_j: between terminals and motor, with braking that the pack does not take.
        cooling_j: compressor and heater.
        auxiliaries_j: of the cooling system.
        consumers_j: beyond the auxiliaries of the parameters, as a plant of an extra draws; 0 without any.
        motor_j: electric energy of the motor, less what it fed back.
        drive_j: losses of motor and driveline.
        brakes_j: braking of the wheels that the motor does not take back.
        rolling_j: rolling resistance.
        air_j: drag.
        climb_j: height gained.
        motion_j: kinetic energy gained, rotating parts included.
    """

    open_circuit_j: float
    cells_j: float
    terminals_j: float
    converters_j: float
    cooling_j: float
    auxiliaries_j: float
    consumers_j: float
    motor_j: float
    drive_j: float
    brakes_j: float
    rolling_j: float
    air_j: float
    climb_j: float
    motion_j: float

    @property
    def uses(self) -> dict[str, float]:
        """What the energy of the cells went into, by name, in J; the values add up to it."""
        return {
            entry.name.removesuffix("_j"): getattr(self, entry.name)
            for entry in fields(self)
            if entry.name not in _SUMS and (entry.name != _OPTIONAL or getattr(self, entry.name))
        }

    @property
    def residual(self) -> float:
        """What the uses lack of the energy of the cells, as a share of it."""
        return 1.0 - sum(self.uses.values()) / self.open_circuit_j


_SUMS = frozenset({"open_circuit_j", "terminals_j", "motor_j"})
_OPTIONAL = "consumers_j"
_ROUNDING_W = 1e-6


def energy_balance(
    run: Trajectory, parameters: ModelParameters, slope: SlopeProfile
) -> EnergyBalance:
    """Return where the energy of a run went.

    Args:
        slope: of the road.
    """

    def integral(means: FloatArray) -> float:
        return float(np.dot(means[1:], run.intervals_s))

    terminals, motor = integral(run.battery_power_w), integral(run.traction_power_w)
    cells = integral(run.battery_heat_w)
    cooling = integral(np.abs(run.compressor_power_w))
    auxiliaries = integral(run.auxiliary_power_w)
    beyond_w = run.auxiliary_power_w - parameters.cooling.auxiliary_power_w
    consumers = integral(np.where(np.abs(beyond_w) > _ROUNDING_W, beyond_w, 0.0))
    rolling, air, climb, motion = _road_load_j(run, parameters, slope)
    at_wheels = rolling + air + climb + motion
    # Of what the wheels brake with, the driveline passes on a share.
    braking = at_wheels < 0.0
    back = (-run.traction_power_w[1:] * run.intervals_s)[braking]
    through = parameters.powertrain.driveline_efficiency
    brakes = float(np.maximum(-at_wheels[braking] * through - np.maximum(back, 0.0), 0.0).sum())
    return EnergyBalance(
        open_circuit_j=terminals + cells,
        cells_j=cells,
        terminals_j=terminals,
        converters_j=terminals - motor - cooling - auxiliaries,
        cooling_j=cooling,
        auxiliaries_j=auxiliaries - consumers,
        consumers_j=consumers,
        motor_j=motor,
        drive_j=motor - float(at_wheels.sum()) - brakes,
        brakes_j=brakes,
        rolling_j=float(rolling.sum()),
        air_j=float(air.sum()),
        climb_j=float(climb.sum()),
        motion_j=float(motion.sum()),
    )


def _road_load_j(
    run: Trajectory, parameters: ModelParameters, slope: SlopeProfile
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return rolling, air, climb and motion of every interval (eq. 2), shape (n - 1,) each.

    Speeds are linear over an interval, so the mean of ``v^3`` is ``(a + b)(a^2 + b^2) / 4``. A vehicle that
    stops within one stands for the rest of it: its way is the one that it drove.
    """
    body = parameters.body
    before, after = run.speed_m_s[:-1], run.speed_m_s[1:]
    way_m = np.diff(run.position_m)
    moves_s = 2.0 * way_m / np.maximum(before + after, 1e-9)
    moves_s = np.minimum(moves_s, run.intervals_s)
    middle = slope.slope_at(0.5 * (run.position_m[1:] + run.position_m[:-1]))
    weight_n = body.mass_kg * body.gravity_m_s2
    drag = 0.5 * body.drag_coefficient * body.frontal_area_m2 * body.air_density_kg_m3
    kinetic_j = 0.5 * body.rotational_inertia_factor * body.mass_kg * run.speed_m_s**2
    return (
        weight_n * body.rolling_resistance * np.cos(middle) * way_m,
        drag * moves_s * 0.25 * (before + after) * (before**2 + after**2),
        weight_n * np.sin(middle) * way_m,
        np.diff(kinetic_j),
    )
