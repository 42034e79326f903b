"""Cabin, heater core, drive and pack: their balances of heat, with the loop of one compressor between them.

    C_a dT_a/dt = G_i (T_i - T_a) + (G_o(v) + c m_f)(T_amb - T_a) + Q_core - Q_eva + persons + blower + sun
    C_i dT_i/dt = G_i (T_a - T_i) + G_io (T_amb - T_i) + sun
    C_h dT_h/dt = Q_condenser + P_ptc - Q_core,    Q_core = G_h (T_h - T_mix)
    C_d dT_d/dt = waste of the drive - what the heat pump takes - G_d(v)(T_d - T_amb)

The pack is the suite's, two cells of a channel with coolant (eqs. 8 to 10 and 15), but that the mean of both
takes exactly what the coolant brings, so that heat is conserved; the reduced channel does that to some per
cent. The coolant meets chiller, condenser and a radiator with a valve, which may be open where it helps.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from iptm_cabin.parameters import CabinParameters, PartFailure
from iptm_cabin.refrigerant_loop import AIR_J_KG_K, LoopState, Surroundings, solve_loop
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.ops import Scalar, exp, maximum
from iptm_core.physics.thermal_loop import Channel, reduce_channel

STATES = ("air_k", "interior_k", "core_k", "drive_k", "cell_1_k", "cell_n_k")
INPUTS = ("cabin_w", "pack_w", "ptc_w", "radiator")
WEATHER = ("speed_m_s", "heat_w", "waste_w", "ambient_k", "sun_w_m2")
PERSON_W = 100.0
_RADIATOR_M_S = 20.0


@dataclass(frozen=True)
class HeatFlows:
    """Heat flows (W) and electric powers (W) at an instant, and rates of STATES (K/s).

    Attributes:
        into_car_w: heat from outside and from persons, sun and drive, and electric power, less what leaves.
        stored_w: rate of the heat in all nodes; equal to `into_car_w`.
        electric_w: power of compressor, heater, fans and blower.
        coolant_in_k: coolant at the inlet of the pack.
    """

    loop: LoopState
    rates: tuple[Scalar, ...]
    into_car_w: Scalar
    stored_w: Scalar
    electric_w: Scalar
    radiator_w: Scalar
    coolant_in_k: Scalar
    coolant_out_k: Scalar
    fans_w: Scalar


class CabinModel:
    """The equations of a car."""

    def __init__(self, cabin: CabinParameters, car: ModelParameters) -> None:
        self.cabin, self.car = cabin, car
        self._channel: Channel = reduce_channel(car.cooling, car.pack)
        self._pack_j_k = car.pack.cells * car.cell.heat_capacity_j_k
        self._flow_w_k = (
            car.cooling.coolant_mass_flow_kg_s * car.cooling.coolant_specific_heat_j_kg_k
        )

    @property
    def capacities_j_k(self) -> tuple[float, ...]:
        """Heat capacities of STATES."""
        cabin, half = self.cabin, 0.5 * self._pack_j_k
        return (
            cabin.air_heat_capacity_j_k,
            cabin.interior_heat_capacity_j_k,
            cabin.core_heat_capacity_j_k,
            cabin.drive_heat_capacity_j_k,
            half,
            half,
        )

    def loop(self, states: Any, inputs: Any, weather: Any, smoothing_w: float = 0.0) -> LoopState:
        """Return the refrigerant loop at an instant."""
        air, _, core, drive, cell_1, cell_n = states
        speed, _, _, ambient, _ = weather
        around = Surroundings(ambient, air, core, 0.5 * (cell_1 + cell_n), drive, speed)
        return solve_loop(inputs[0], inputs[1], around, self.cabin, smoothing_w)

    def flows(
        self,
        states: Any,
        inputs: Any,
        weather: Any,
        smoothing_w: float = 0.0,
        loop: LoopState | None = None,
    ) -> HeatFlows:
        """Return all flows.

        Args:
            states: of STATES, in K.
            inputs: of INPUTS: heat into the core and the pack by the loop (negative: out of the cabin's air
                and the pack) and of the heater in W, opening of the radiator's valve from 0 to 1.
            weather: of WEATHER: speed, heat of all cells, waste heat of the drive, air and sun.
            loop: where it is held, that one.
        """
        cabin = self.cabin
        air, interior, core, drive, cell_1, cell_n = states
        cabin_w, pack_w, ptc_w, valve = inputs
        speed, heat_w, waste_w, ambient, sun_w_m2 = weather
        loop = loop or self.loop(states, inputs, weather, smoothing_w)
        to_core_w = maximum(cabin_w, 0.0, smoothing_w)
        from_air_w = to_core_w - cabin_w

        fresh_w_k = AIR_J_KG_K * cabin.fresh_share * cabin.blown_air_kg_s
        mixed = cabin.fresh_share * ambient + (1.0 - cabin.fresh_share) * air
        core_w = cabin.core_conductance_w_k * (core - mixed)
        shell_w_k = (
            cabin.shell_conductance_w_k
            + cabin.shell_conductance_j_k_m * speed
            + cabin.open_windows_w_k
            + fresh_w_k
        )
        shell_w = shell_w_k * (ambient - air)
        within_w = cabin.interior_conductance_w_k * (interior - air)
        board_w = cabin.interior_outside_w_k * (ambient - interior)
        sun_w = cabin.sun_aperture_m2 * sun_w_m2
        persons_w = PERSON_W * cabin.occupants
        blower_w = 0.0 if cabin.broken is PartFailure.FAN else cabin.blower_power_w
        to_cabin_w = within_w + shell_w + core_w - from_air_w + persons_w + blower_w
        to_cabin_w = to_cabin_w + cabin.sun_share_of_air * sun_w
        to_interior_w = board_w - within_w + (1.0 - cabin.sun_share_of_air) * sun_w
        to_heater_w = to_core_w + ptc_w - core_w
        wind = (0.3 + speed / _RADIATOR_M_S) ** 0.6
        shed_w = cabin.drive_radiator_w_k * wind * (drive - ambient)
        to_drive_w = waste_w - loop.waste_w - shed_w

        weights, flow = self._channel.outlet, self._flow_w_k
        conductance = cabin.radiator_w_k * wind * valve
        kept = 1.0 - weights.inlet + weights.inlet * conductance / flow
        of_cells = weights.cell_1 * (cell_1 - ambient) + weights.cell_n * (cell_n - ambient)
        out_k = ambient + (of_cells + weights.inlet * pack_w / flow) / kept
        radiator_w = conductance * (out_k - ambient)
        taken_w = radiator_w - pack_w
        in_k = out_k - taken_w / flow

        car = self.car
        capacity = car.cell.heat_capacity_j_k
        exchange = car.cooling.convective_coefficient_w_k / capacity
        coolant_n = self._channel.last_cell.temperature_k(in_k, cell_1, cell_n)
        by_air_w_k = car.cooling.air_exchange_w_k / car.pack.cells
        air_1, air_n = by_air_w_k * (ambient - cell_1), by_air_w_k * (ambient - cell_n)
        outside_w = 0.5 * car.pack.cells * (air_1 + air_n)
        mean_rate = (heat_w + outside_w - taken_w) / self._pack_j_k
        apart = 0.5 * (air_n - air_1) / capacity
        apart = apart + 0.5 * exchange * (coolant_n - cell_n - in_k + cell_1)
        gains = (to_cabin_w, to_interior_w, to_heater_w, to_drive_w)
        rates = (
            *(gain / own for gain, own in zip(gains, self.capacities_j_k, strict=False)),
            mean_rate - apart,
            mean_rate + apart,
        )
        fans_w = loop.fan_w + cabin.radiator_fan_w * valve * exp(-speed / 8.0)
        stored_w = sum(
            (each * own for each, own in zip(rates, self.capacities_j_k, strict=True)), 0.0
        )
        into_w = shell_w + board_w + sun_w + persons_w + blower_w
        into_w = into_w + ptc_w + waste_w - shed_w + heat_w + outside_w - radiator_w
        into_w = into_w + loop.power_w - loop.shell_w - loop.to_air_w + loop.latent_w
        return HeatFlows(
            loop=loop,
            rates=rates,
            into_car_w=into_w,
            stored_w=stored_w,
            electric_w=loop.power_w + ptc_w + fans_w + blower_w,
            radiator_w=radiator_w,
            coolant_in_k=in_k,
            coolant_out_k=out_k,
            fans_w=fans_w,
        )

    def drive_waste_w(self, traction_power_w: Scalar) -> Scalar:
        """Return the heat of motor and inverter."""
        return self.cabin.drive_waste_share * maximum(traction_power_w, -traction_power_w)
