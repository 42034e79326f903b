"""Predictive climate control: cabin, pack, heater and radiator over the minutes ahead, motion given.

A second problem at a slower rate than the controller's: steps of 30 s over `horizon_s`, 10 minutes, with the
speed that navigation or preview expects. Its first inputs are held for a step and pass the limits of the
parts every tick. It minimises, in joules,

    electric energy + ohmic loss and ageing of the pack + w (T_a - T_set)^2
    + exact penalty outside of the band - value of the heat left in cabin and pack,

with power, capacity and frost of the one compressor as hard limits. Motion is no input of it: a kelvin moves
the energy of the drive by far less than the drive moves the kelvin, and the fast problem stays as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from iptm_cabin.climate_control import HOTTEST_CORE_C, ClimateUnit, Memory
from iptm_cabin.parameters import CabinParameters
from iptm_cabin.thermal_functions import Inputs, ThermalFunctions
from iptm_cabin.thermal_model import INPUTS, STATES, CabinModel
from iptm_core.errors import ScenarioError
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.cell import cell_resistance_ohm, nominal_charge_parameters
from iptm_core.physics.ops import named_function
from iptm_core.physics.power_thermal import CellPair, power_thermal_rates
from iptm_core.physics.thermal_loop import reduce_channel
from iptm_core.routes.cycles import CYCLE_NAMES, load_cycle
from iptm_core.state import FloatArray, LeaderPreview, VehicleState
from iptm_core.units import CELSIUS_ZERO_K

STEP_S = 30.0
WARM_UP_S = 600.0
SUB_STEPS = 2
SMOOTHING_W = 40.0
HEATING_VALUE, COOLING_VALUE = 2.2, 3.0
"""COP at which the heat left in the cabin at the end counts."""
REFERENCE_K = 298.15
_SCALE_J = 1e-5
_LEAST_MARGIN = 0.01
_LARGEST_W = 8000.0
_HOTTEST_PRICE_W_K = 2000.0
_EXPECTED = (
    "speed_m_s",
    "ohmic_w",
    "other_heat_w",
    "waste_w",
    "aging_1_s",
    "weight",
    "comfort_w_k2",
)


@dataclass(frozen=True)
class WayAhead:
    """Motion and pack that are expected, in means over steps of 30 s from the start of the trip.

    Attributes:
        ohmic_w: ohmic heat of the pack at 25 degC.
        other_heat_w: entropic heat.
        waste_w: heat of motor and inverter.
        aging_1_s: rate of the capacity loss at 25 degC.
    """

    speed_m_s: FloatArray
    ohmic_w: FloatArray
    other_heat_w: FloatArray
    waste_w: FloatArray
    aging_1_s: FloatArray

    def steps(self, time_s: float, count: int, cabin: CabinParameters) -> FloatArray:
        """Return the expected conditions in steps from a time on, shape (n, 7).

        Columns are the ones above, whether a step lies within the trip, and the price of comfort, which is
        another one in the first ten minutes.
        """
        first = round(time_s / STEP_S)
        indices = np.arange(first, first + count)
        inside = (indices < self.speed_m_s.size).astype(np.float64)
        warming = indices * STEP_S < WARM_UP_S
        price = np.where(warming, cabin.warm_up_price_w_k2, cabin.comfort_price_w_k2)
        at = np.minimum(indices, self.speed_m_s.size - 1)
        return np.column_stack([*(each[at] for each in vars(self).values()), inside, price])


def expected(
    speeds_m_s: FloatArray, car: ModelParameters, model: CabinModel, step_s: float = 1.0
) -> WayAhead:
    """Return the way ahead of speeds at equal steps, on a flat road with cells of 25 degC."""
    car = nominal_charge_parameters(car)
    middle = 0.5 * (speeds_m_s[:-1] + speeds_m_s[1:])
    limits = car.limits
    gains = np.clip(
        np.diff(speeds_m_s) / step_s, limits.min_acceleration_m_s2, limits.max_acceleration_m_s2
    )
    zeros = np.zeros(middle.size)
    cells = CellPair(REFERENCE_K, REFERENCE_K, 1e-5, 1e-5)
    channel = reduce_channel(car.cooling, car.pack)
    with np.errstate(invalid="ignore"):
        rates = power_thermal_rates(middle, gains, zeros, zeros, cells, car, channel)
    current = np.nan_to_num(np.asarray(rates.cell_current_a))
    ohm = float(cell_resistance_ohm(REFERENCE_K, 1e-5, car.cell))
    ohmic = current**2 * ohm * car.pack.cells
    other = current * car.cell.entropic_coefficient_v_k * REFERENCE_K * car.pack.cells
    waste = model.cabin.drive_waste_share * np.abs(
        np.nan_to_num(np.asarray(rates.traction_power_w))
    )
    aging = 0.5 * (rates.cell_1_capacity_loss_rate_1_s + rates.cell_n_capacity_loss_rate_1_s)
    aging = np.nan_to_num(np.asarray(aging))
    per = round(STEP_S / step_s)
    count = max(math.ceil(middle.size / per), 1)

    def binned(values: FloatArray) -> FloatArray:
        return np.array([values[i * per : (i + 1) * per].mean() for i in range(count)])

    return WayAhead(*(binned(each) for each in (middle, ohmic, other, waste, aging)))


def way_ahead(cabin: CabinParameters, car: ModelParameters) -> WayAhead | None:
    """Return the way ahead that a file states, None for none.

    Raises:
        ScenarioError: the cycle is unknown.
    """
    if not cabin.way_ahead:
        return None
    if cabin.way_ahead not in CYCLE_NAMES:
        allowed = ", ".join(CYCLE_NAMES)
        raise ScenarioError(f"way_ahead is {cabin.way_ahead!r}; allowed: {allowed}")
    return expected(load_cycle(cabin.way_ahead).speeds_m_s, car, CabinModel(cabin, car))


def value_of_states_j_k(model: CabinModel, ambient_k: float) -> tuple[float, ...]:
    """Return what a kelvin more of STATES is worth in J of electric energy at the end of a trip."""
    heats = ambient_k < model.cabin.set_point_c + CELSIUS_ZERO_K - 2.0
    worth = 1.0 / HEATING_VALUE if heats else -1.0 / COOLING_VALUE
    air, interior, core, *_ = model.capacities_j_k
    pack = 0.5 * model.cabin.pack_price_j_k
    return air * worth, interior * worth, core * worth * heats, 0.0, pack, pack


class ThermalPlan:
    """The problem over a number of steps, solved by IPOPT.

    Attributes:
        count: number of steps.
    """

    def __init__(self, model: CabinModel, count: int) -> None:
        self._model, self.count = model, count
        n, m = len(STATES), len(INPUTS)
        states, inputs = ca.SX.sym("x", n), ca.SX.sym("u", m)
        ahead, ambient = ca.SX.sym("d", len(_EXPECTED)), ca.SX.sym("ambient")
        self._stage = self._stage_function(states, inputs, ahead, ambient)
        x, u = ca.MX.sym("X", n, count + 1), ca.MX.sym("U", m, count)
        slack = ca.MX.sym("S", 1, count)
        d, start, air = ca.MX.sym("D", len(_EXPECTED), count), ca.MX.sym("x0", n), ca.MX.sym("a")
        value, price = ca.MX.sym("value", n), ca.MX.sym("price", 3)
        mapped = self._stage.map(count)
        reached, cost_j, margins = mapped(x[:, :-1], u, d, ca.repmat(air, 1, count))
        set_k = model.cabin.set_point_c
        apart = x[0, 1:] * 10.0 - set_k
        weight, comfort = d[5, :], d[6, :] * apart * apart + price[0] * slack
        hot = 0.5 * (x[4, 1:] + x[5, 1:]) * 10.0 - price[2]
        comfort = comfort + _HOTTEST_PRICE_W_K * 0.5 * (hot + ca.sqrt(hot * hot + 0.04))
        objective = ca.sum2(cost_j + STEP_S * weight * comfort)
        objective = objective - ca.dot(value, x[:, -1] * 10.0)
        band = ca.vertcat(slack - (apart - price[1]), slack - (-apart - price[1]))
        constraints = ca.vertcat(
            ca.vec(ca.horzcat(x[:, 0] - start, x[:, 1:] - reached)), ca.vec(margins), ca.vec(band)
        )
        equal, free = n * (count + 1), margins.numel() + band.numel()
        self._low = np.zeros(equal + free)
        self._high = np.r_[np.zeros(equal), np.full(free, np.inf)]
        self._low[equal : equal + margins.numel()] = _LEAST_MARGIN
        z = ca.vertcat(ca.vec(x), ca.vec(u), ca.vec(slack))
        problem: Any = {
            "x": z,
            "f": objective * _SCALE_J,
            "g": constraints,
            "p": ca.vertcat(start, air, value, price, ca.vec(d)),
        }
        options: Any = {"ipopt.print_level": 0, "print_time": 0, "ipopt.sb": "yes"}
        options |= {"ipopt.max_iter": 200, "ipopt.tol": 1e-6, "ipopt.acceptable_tol": 1e-4}
        self._solver = ca.nlpsol("thermal", "ipopt", problem, options)
        cabin = model.cabin
        heats = _LARGEST_W / 1e3 if cabin.is_heat_pump else 0.0
        pack = cabin.max_pack_heat_w / 1e3
        most = (heats, pack if cabin.is_heat_pump else 0.0, cabin.max_ptc_power_w / 1e3, 1.0)
        least = (-_LARGEST_W / 1e3, -pack, 0.0, 0.0)
        hottest = np.tile([9.0, 9.0, HOTTEST_CORE_C / 10.0, 15.0, 9.0, 9.0], count + 1)
        hottest[: len(STATES)] = 20.0
        self._most = np.r_[hottest, np.tile(most, count), np.full(count, np.inf)]
        self._least = np.r_[np.full(n * (count + 1), -6.0), np.tile(least, count), np.zeros(count)]
        self._last: FloatArray | None = None

    def _stage_function(
        self, states: ca.SX, inputs: ca.SX, ahead: ca.SX, ambient: ca.SX
    ) -> ca.Function:
        """Return the states after a step (in 10 degC), its cost in J, and the margins of the loop.

        Inputs are in kW; steps beyond the trip change nothing and cost nothing.
        """
        model, car = self._model, nominal_charge_parameters(self._model.car)
        speed, ohmic, other, waste, aging, weight, _ = ca.vertsplit(ahead)
        given = [each * 1e3 for each in ca.vertsplit(inputs)[:3]] + [inputs[3]]
        now = 10.0 * states + CELSIUS_ZERO_K
        reference = cell_resistance_ohm(REFERENCE_K, 1e-5, car.cell)
        sun = model.cabin.sun_w_m2

        def weather(at: Any) -> tuple[Any, ...]:
            grown = cell_resistance_ohm(0.5 * (at[4] + at[5]), 1e-5, car.cell) / reference
            return speed, ohmic * grown + other, waste, ambient, sun

        loop = model.loop(ca.vertsplit(now), given, weather(now), SMOOTHING_W)
        electric = model.flows(ca.vertsplit(now), given, weather(now), SMOOTHING_W, loop).electric_w
        pack = 0.5 * (now[4] + now[5])
        law = car.aging
        steepness = law.activation_energy_j_mol / (
            law.throughput_exponent * law.gas_constant_j_mol_k
        )
        aged = aging * ca.exp(steepness * (1.0 / REFERENCE_K - 1.0 / pack))
        cost = weight * STEP_S * (electric + weather(now)[1] - other)
        cost = cost + weight * STEP_S * model.cabin.aging_price_j * aged
        h = STEP_S / SUB_STEPS
        at = now

        def rates(node: Any) -> Any:
            flows = model.flows(ca.vertsplit(node), given, weather(node), SMOOTHING_W, loop)
            return ca.vertcat(*flows.rates)

        for _ in range(SUB_STEPS):
            at = at + h * rates(at + 0.5 * h * rates(at))
        reached = states + weight * (at - now) / 10.0
        arguments = {"x": states, "u": inputs, "d": ahead, "ambient": ambient}
        results = {"next": reached, "cost": cost, "margins": ca.vertcat(*loop.margins)}
        return named_function("thermal_stage", arguments, results, cse=True)

    def solve(
        self, states_k: tuple[float, ...], ahead: FloatArray, ambient_k: float
    ) -> tuple[FloatArray, FloatArray] | None:
        """Return the best inputs, shape (n, 4), and states in K, shape (n + 1, 6); None without success."""
        cabin, n, count = self._model.cabin, len(STATES), self.count
        start = (np.array(states_k) - CELSIUS_ZERO_K) / 10.0
        value = value_of_states_j_k(self._model, ambient_k)
        hottest_c = self._model.car.limits.max_temperature_k - CELSIUS_ZERO_K
        price = (cabin.band_price_w_k, cabin.band_k, hottest_c)
        given = np.concatenate([start, [ambient_k], value, price, ahead.ravel()])
        guess = self._last
        if guess is None:
            heats = cabin.set_point_c + CELSIUS_ZERO_K > ambient_k
            first = (1.5 if heats else -1.5) * (1.0 if cabin.is_heat_pump or not heats else 0.0)
            guess = np.r_[
                np.tile(start, count + 1), np.tile([first, 0.0, 0.3, 0.2], count), np.ones(count)
            ]
        most, least = self._most.copy(), self._least.copy()
        if (
            ambient_k < cabin.set_point_c + CELSIUS_ZERO_K
        ):  # the loop is reversed for both or neither
            least[n * (count + 1) : -count : len(INPUTS)] = 0.0
            least[n * (count + 1) + 1 : -count : len(INPUTS)] = 0.0
        else:
            most[n * (count + 1) + 1 : -count : len(INPUTS)] = 0.0
            most[n * (count + 1) : -count : len(INPUTS)] = 0.0
        limits = {"lbx": least, "ubx": most, "lbg": self._low, "ubg": self._high}
        found = self._solver(x0=guess, p=given, **limits)
        solution: FloatArray = np.array(found["x"]).ravel()
        if not self._solver.stats()["success"]:
            self._last = None
            return None
        self._last = solution
        inputs = solution[n * (count + 1) : -count].reshape(count, len(INPUTS))
        states = solution[: n * (count + 1)].reshape(count + 1, n)
        return inputs * (1e3, 1e3, 1e3, 1.0), 10.0 * states + CELSIUS_ZERO_K

    def forget(self) -> None:
        """Begin without a last solution."""
        self._last = None


class PredictiveUnit(ClimateUnit):
    """Climate control by `ThermalPlan`; where it fails, by rules.

    It remembers the last plan, so that an instance belongs to one trip at a time.
    """

    def __init__(self, functions: ThermalFunctions, ahead: WayAhead | None) -> None:
        """Keep the expected conditions.

        Args:
            ahead: the whole way; None for the preview's speed.
        """
        super().__init__(functions)
        self._ahead = ahead
        self._count = math.ceil(functions.model.cabin.horizon_s / STEP_S)
        self._from_s = -math.inf
        self._time_s = 0.0
        self._inputs: FloatArray | None = None
        self._seen: WayAhead | None = None
        self.failures = 0

    @cached_property
    def _plan(self) -> ThermalPlan:
        return ThermalPlan(self._functions.model, self._count)

    def look_ahead(self, state: VehicleState, heard: LeaderPreview) -> None:
        """Take time and preview of an interval."""
        self._time_s = state.time_s
        if self._ahead is None and self._due:
            speed = state.speed_m_s
            if heard.times_s.size > 1:
                speeds = np.diff(heard.positions_m) / np.diff(heard.times_s)
                speed = float(speeds.mean())
            model = self._functions.model
            self._seen = expected(
                np.full(round(WARM_UP_S + (self._count + 1) * STEP_S) + 1, speed), model.car, model
            )

    @property
    def _due(self) -> bool:
        return not self._from_s <= self._time_s < self._from_s + STEP_S - 1e-9

    def decide(
        self,
        states: tuple[float, ...],
        weather: tuple[float, ...],
        memory: Memory,
        commanded_w: float,  # noqa: ARG002  the plan decides on the pack
        duration_s: float,
    ) -> tuple[Inputs, Memory, str]:
        """Return the inputs of the plan, as `ClimateUnit.decide`."""
        reading_k, memory, report = self._measure(states[0], memory, duration_s)
        if self._due and not math.isnan(reading_k):
            self._replan(states, weather)
        if self._inputs is None or math.isnan(reading_k):
            inputs, memory, by_rule = super().decide(states, weather, memory, 0.0, 0.0)
            return inputs, memory, report or by_rule or "no plan; the cabin is kept by rules"
        number = int((self._time_s - self._from_s) / STEP_S + 1e-9)
        cabin_w, pack_w, ptc_w, radiator = self._inputs[min(number, len(self._inputs) - 1)].tolist()
        inputs, limited = self.within(
            states, weather, cabin_w + ptc_w, pack_w, radiator, ptc_w, by_loop_w=cabin_w
        )
        return inputs, memory, report or limited

    def _replan(self, states: tuple[float, ...], weather: tuple[float, ...]) -> None:
        began, cabin = self._time_s, self._functions.model.cabin
        if began < self._from_s:
            self._plan.forget()
        if self._ahead is not None:
            expected_steps = self._ahead.steps(began, self._count, cabin)
        elif self._seen is not None:
            expected_steps = self._seen.steps(min(began, WARM_UP_S), self._count, cabin)
        else:
            return
        found = self._plan.solve(states, expected_steps, weather[3])
        self.failures += found is None
        self._from_s = began
        self._inputs = None if found is None else found[0]
