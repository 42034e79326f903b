"""From the last plan to the next problem, and from its solution to a plan: in Python, or the same in C.

Both give the same numbers, to the last bit. The Python form is what a reader takes up, runs where there is no
compiler, and poses problems on grids whose longer steps are watched inside.
"""

from __future__ import annotations

import ctypes
import struct
from operator import attrgetter
from typing import Any

import numpy as np

from iptm_controller.ocp import layout
from iptm_controller.ocp.data import UNBOUNDED_W, ProblemData, ProblemDataBuilder
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.layout import StateIndex
from iptm_controller.plan import (
    Plan,
    PlanShifter,
    plan_from_variables,
    sample_positions_m,
    variables_from_plan,
)
from iptm_controller.temperature_value import TemperatureValue
from iptm_controller.tick_library import (
    DOUBLE,
    INT,
    POINTER,
    numbers_of,
    tick_library,
    vehicle,
)
from iptm_core.physics.ops import address
from iptm_core.state import FloatArray, LeaderPreview, SlopePreview, VehicleState


class PlanData:
    """Poses problems around plans, and reads plans from solutions.

    Attributes:
        builder: works the numbers of a problem out.
        charge_w: charging power that the newest problem was posed with.
    """

    def __init__(self, grid: ProblemGrid, builder: ProblemDataBuilder) -> None:
        self._grid = grid
        self._shifter = PlanShifter(grid.horizon)
        self.charge_w = UNBOUNDED_W
        self.builder = builder

    def expected(self, last: Plan | None, state: VehicleState) -> Plan:
        """Return the last plan as seen from a later state; without one, speed and power are kept."""
        if last is None:
            return self._shifter.cold_start(state)
        return self._shifter.shift(last, state)

    def problem(
        self,
        state: VehicleState,
        last: Plan | None,
        leader: LeaderPreview,
        limiting: LeaderPreview,
        slope: SlopePreview,
        known_s: float,
        value: TemperatureValue,
        thermal_samples: FloatArray | None,
        speed_limits_m_s: FloatArray | None,
        charge_w: float = UNBOUNDED_W,
        *,
        follows: bool = True,
    ) -> tuple[ProblemData, FloatArray]:
        """Return the problem around the expected plan, and that plan in the units of the solver.

        Args:
            last: plan of an earlier tick, None without one.
            leader: past and expected motion of the leader.
            limiting: motion that the gap limits hold for.
            known_s: how far ahead the motion is known.
            charge_w: largest charging power of the pack.
            follows: a lead vehicle is ahead, not only rules of the road.
        """
        self.charge_w = charge_w
        guess = self.expected(last, state)
        data = self.builder.build(
            state,
            leader,
            slope,
            sample_positions_m(guess, self._grid.sample_times_s),
            known_s,
            value,
            thermal_samples,
            guess.states[:, StateIndex.SPEED],
            limiting,
            speed_limits_m_s,
            charge_w,
            follows=follows,
        )
        return data, variables_from_plan(guess, self._grid, state)

    def plan(self, variables: FloatArray, state: VehicleState) -> Plan:
        """Return a solution in physical units."""
        return plan_from_variables(variables, self._grid, state)


_MOTIONS_KEPT = 8
_motions: dict[int, tuple[LeaderPreview, CMotion]] = {}
"""Motions of the newest previews, by the identity of the preview."""


class CMotion(ctypes.Structure):
    """The nodes of a preview."""

    _fields_ = (
        ("nodes", INT),
        ("times_s", POINTER),
        ("positions_m", POINTER),
        ("speeds_m_s", POINTER),
        ("bounds_m", POINTER),
    )


def motion_of(preview: LeaderPreview) -> CMotion:
    """Return the nodes of a preview; -1 of them where its columns differ in length."""
    kept = _motions.get(id(preview))
    if kept is not None:
        return kept[1]
    columns = [preview.times_s, preview.positions_m, preview.speeds_m_s]
    columns += [preview.bounds_m] if preview.bounds_m.size else []
    arrays = [np.ascontiguousarray(each, dtype=np.float64) for each in columns]
    (size, *others) = {each.size for each in arrays}
    motion = CMotion(-1 if others else size, *[address(each) for each in arrays])
    motion.kept = arrays
    return keep_motion(preview, motion)


def keep_motion(preview: LeaderPreview, motion: CMotion) -> CMotion:
    """Note the motion of a preview, whose arrays it points to."""
    if len(_motions) >= _MOTIONS_KEPT:
        _motions.clear()
    _motions[id(preview)] = preview, motion
    return motion


class _Grid(ctypes.Structure):
    _fields_ = (
        *((name, INT) for name in ("steps", "motion_steps", "samples", "motion_samples")),
        *(
            (name, POINTER)
            for name in (
                "nodes_s",
                "lengths_s",
                "acceleration_intervals_s",
                "compressor_intervals_s",
                "sample_times_s",
                "sample_steps",
                "step_places",
                "sample_places",
            )
        ),
        ("max_speed_m_s", DOUBLE),
    )


class _Strategy(ctypes.Structure):
    _fields_ = (
        ("scale", DOUBLE),
        ("weights", DOUBLE * len(layout.WEIGHTS)),
        ("reference_temperature_k", DOUBLE),
        ("min_temperature_k", DOUBLE),
        ("coldest_below_limit_k", DOUBLE),
        ("headway_price_1_m2_s", DOUBLE),
    )


class _Slope(ctypes.Structure):
    _fields_ = (("nodes", INT), ("positions_m", POINTER), ("slopes_rad", POINTER))


_PRICES = (
    "cell_1_marginal_cost_1_k",
    "cell_n_marginal_cost_1_k",
    "temperature_weight_1_k2_s",
    "reference_temperature_k",
    "thermal_energy_price_1_j",
)
_prices_of = attrgetter(*_PRICES)


_AHEAD = struct.Struct("5P8d")
"""Of ``iptm_ahead``: where motion, limiting motion, slope, speed limits and samples are, then the numbers."""


class PlanDataInC(PlanData):
    """The same in C, for one thread."""

    def __init__(
        self, grid: ProblemGrid, builder: ProblemDataBuilder, library: ctypes.PyDLL
    ) -> None:
        super().__init__(grid, builder)
        horizon = grid.horizon
        nodes_s = horizon.node_times_s
        steps = np.searchsorted(nodes_s, grid.sample_times_s, side="right") - 1
        self._nodes_s = nodes_s
        arrays = [
            nodes_s,
            horizon.step_lengths_s,
            builder.acceleration_intervals_s,
            builder.compressor_intervals_s,
            grid.sample_times_s,
            np.clip(steps, 0, grid.steps - 1).astype(np.intc),
            grid.step_places.astype(np.intc),
            grid.sample_places.astype(np.intc),
        ]
        self._kept = arrays  # the structure holds their addresses
        self._c_grid = _Grid(
            grid.steps,
            horizon.motion_steps,
            grid.sample_times_s.size,
            grid.motion_samples,
            *(array.ctypes.data for array in arrays),
            builder.max_speed_m_s,
        )
        self._grid_pointer = ctypes.byref(self._c_grid)
        strategy = builder.strategy
        self._strategy = _Strategy(
            strategy.scale,
            tuple(strategy.weights.values()),
            strategy.reference_temperature_k,
            builder.min_temperature_k,
            strategy.coldest_below_limit_k,
            strategy.headway_price_1_m2_s,
        )
        self._strategy_pointer = ctypes.byref(self._strategy)
        plan_size = (grid.steps + 1) * layout.STATES + grid.steps * layout.INPUTS
        self._plan_numbers: Any = DOUBLE * plan_size
        self._variables: Any = DOUBLE * grid.variable_count
        self._parameters: Any = DOUBLE * grid.parameter_count
        self._expected = self._empty_plan()
        self._slope: SlopePreview | None = None
        self._newest: tuple[Plan | None, int, int] = None, 0, 0
        self._vehicle, self._write_vehicle = vehicle()
        self._ahead = ctypes.create_string_buffer(_AHEAD.size)
        self._shift = library.iptm_shift_plan
        self._pose = library.iptm_pose_problem
        self._read = library.iptm_read_plan

    def expected(self, last: Plan | None, state: VehicleState) -> Plan:
        """See ``PlanData``."""
        self._write_vehicle(*numbers_of(state))
        numbers, *places = self._empty_plan()
        start_s = 0.0 if last is None else last.start_s
        self._shift(self._grid_pointer, start_s, *self._places(last), self._vehicle, *places)
        return self._plan_of(numbers, state)

    def problem(
        self,
        state: VehicleState,
        last: Plan | None,
        leader: LeaderPreview,
        limiting: LeaderPreview,
        slope: SlopePreview,
        known_s: float,
        value: TemperatureValue,
        thermal_samples: FloatArray | None,
        speed_limits_m_s: FloatArray | None,
        charge_w: float = UNBOUNDED_W,
        *,
        follows: bool = True,
    ) -> tuple[ProblemData, FloatArray]:
        """See ``PlanData``."""
        self.charge_w = charge_w
        variables, parameters = self._variables(), self._parameters()
        if self._slope is not slope:
            road = [
                np.ascontiguousarray(each, dtype=np.float64)
                for each in (slope.positions_m, slope.slopes_rad)
            ]
            self._slope, self._road = slope, road
            self._c_slope = _Slope(road[0].size, *map(address, road))
        motion = motion_of(leader)
        limits = motion if limiting is leader else motion_of(limiting)
        _AHEAD.pack_into(
            self._ahead,
            0,
            ctypes.addressof(motion),
            ctypes.addressof(limits),
            ctypes.addressof(self._c_slope),
            0 if speed_limits_m_s is None else address(speed_limits_m_s),
            0 if thermal_samples is None else address(thermal_samples),
            known_s,
            charge_w,
            follows,
            *_prices_of(value),
        )
        start_s, (_, *places) = 0.0 if last is None else last.start_s, self._expected
        self._write_vehicle(*numbers_of(state))
        self._shift(self._grid_pointer, start_s, *self._places(last), self._vehicle, *places)
        self._pose(
            self._grid_pointer,
            self._strategy_pointer,
            self._vehicle,
            self._ahead,
            *places,
            variables,
            parameters,
        )
        start = np.frombuffer(variables)
        return ProblemData(start[: layout.STATES].copy(), np.frombuffer(parameters)), start

    def plan(self, variables: FloatArray, state: VehicleState) -> Plan:
        """See ``PlanData``."""
        numbers, *places = self._empty_plan()
        self._read(self._grid_pointer, state.position_m, address(variables), *places)
        plan = self._plan_of(numbers, state)
        self._newest = plan, places[0], places[1]
        return plan

    def _empty_plan(self) -> tuple[FloatArray, int, int]:
        """Return room for the numbers of a plan, and where its states and inputs are."""
        numbers = self._plan_numbers()
        first = ctypes.addressof(numbers)
        size = ctypes.sizeof(DOUBLE) * (self._grid.steps + 1) * layout.STATES
        return np.frombuffer(numbers), first, first + size

    def _plan_of(self, numbers: FloatArray, state: VehicleState) -> Plan:
        size = (self._grid.steps + 1) * layout.STATES
        states = numbers[:size].reshape(-1, layout.STATES)
        inputs = numbers[size:].reshape(-1, layout.INPUTS)
        return Plan(state.time_s, self._nodes_s, states, inputs, self._c_grid.motion_steps)

    def _places(self, plan: Plan | None) -> tuple[int | None, int | None]:
        newest, *places = self._newest
        if plan is None or plan.states.shape != (self._grid.steps + 1, layout.STATES):
            return None, None
        if plan is newest:
            return places[0], places[1]
        return address(plan.states), address(plan.inputs)


def plan_data(grid: ProblemGrid, builder: ProblemDataBuilder) -> PlanData:
    """Return the form in C where the grid allows it."""
    if builder.watches_inside:
        return PlanData(grid, builder)
    return PlanDataInC(grid, builder, tick_library())
