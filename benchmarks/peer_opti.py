"""The peer: the same optimal control problem as a careful user writes it with CasADi's Opti and IPOPT.

Same physics functions, limits, slacks, scaling and quadrature; one symbolic function per step length,
multiple shooting, scalar expansion, primal warm start. What it leaves out is what the controller adds:
stage structure, stage-wise mapped derivatives and compiled code.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import casadi as ca
import numpy as np

from benchmarks.harness import run_benchmark
from benchmarks.record_problems import ProblemSet
from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.grid import StageKind, quadrature
from iptm_controller.ocp.layout import GlobalIndex, InputIndex, SampleIndex, StateIndex, StepIndex
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.ocp.stage import (
    GAP_SMOOTHING_M,
    INACTIVE_ROW_M,
    LONGEST_STEP_WITHOUT_SAMPLED_GAP_S,
    cold_cost,
)
from iptm_controller.solvers.factory import build_plain_solver
from iptm_controller.solvers.interface import SolveResult, SolverOptions
from iptm_core.decision_record import SolveStatus
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.braking import braking_reserve_m
from iptm_core.physics.chiller import largest_useful_power_w
from iptm_core.physics.coolant import reduce_channel
from iptm_core.physics.gap_policy import minimum_gap_m
from iptm_core.physics.longitudinal import advance_position_m, advance_speed_m_s
from iptm_core.physics.ops import maximum
from iptm_core.physics.power_thermal import CellPair, power_thermal_rates
from iptm_core.state import FloatArray

POSITION_SCALE_M = 10.0
POWER_SCALE_W = 1000.0
WARM_K = 303.15
MOTION = 4  # position, speed and the two cell temperatures


class OptiPeer:
    """The problem of one grid in Opti; see ``SolverBackend``."""

    name = "peer"
    compiled = False

    def __init__(
        self, problem: OptimalControlProblem, tolerance: float = 1e-5, *, expand: bool = True
    ) -> None:
        """Write the problem down.

        Args:
            problem: horizon, vehicle, formulation.
            tolerance: IPOPT's ``tol``.
            expand: let CasADi expand the whole problem into scalar operations, an option that a
                user has to know; without it the step functions are called as functions.
        """
        self._problem = problem
        self._grid = problem.grid
        steps = self._grid.steps
        opti = ca.Opti()
        self._states = opti.variable(MOTION, steps + 1)
        self._acceleration = opti.variable(1, steps)
        self._power = opti.variable(1, steps)
        self._slacks = opti.variable(layout.SLACKS, steps)
        self._start = opti.parameter(layout.STATES)
        self._parameters = opti.parameter(self._grid.parameter_count)
        self._opti = opti
        self._write(problem.model)
        opti.solver(
            "ipopt",
            {"expand": expand, "print_time": False, "detect_simple_bounds": True},
            {"print_level": 0, "sb": "yes", "tol": tolerance, "max_iter": 500},
        )

    def _write(self, parameters: ModelParameters) -> None:
        opti, start, slacks = self._opti, self._start, self._slacks
        acceleration, power = self._acceleration, self._power
        limits, gap_policy = parameters.limits, parameters.gap
        functions = [
            function
            for kind in self._grid.stages
            for function in [_step_function(kind, self._problem)] * kind.count
        ]
        shared = self._parameters[: layout.GLOBALS]
        opti.subject_to(self._states[:, 0] == start[:MOTION])
        opti.subject_to(opti.bounded(0.0, ca.vec(slacks), np.inf))
        opti.subject_to(
            opti.bounded(limits.min_acceleration_m_s2, acceleration, limits.max_acceleration_m_s2)
        )
        opti.subject_to(
            opti.bounded(
                limits.min_compressor_power_w / POWER_SCALE_W,
                power,
                largest_useful_power_w(parameters.chiller, limits) / POWER_SCALE_W,
            )
        )
        weights = self._problem.penalties
        last_acceleration, last_power = start[StateIndex.LAST_ACCELERATION], start[-1]
        cost = ca.MX(0.0)
        lengths = self._grid.horizon.step_lengths_s.tolist()
        for k, (length, place) in enumerate(zip(lengths, self._grid.step_parameters, strict=True)):
            p = self._parameters[place]
            now, after = self._states[:, k], self._states[:, k + 1]
            end, stage_cost, outlet_k, margins, floors = functions[k](
                now, acceleration[k], power[k], p[layout.STEP_PARAMETERS :], shared
            )
            opti.subject_to(after == end)
            jerk_s, rate_s = p[StepIndex.ACCELERATION_INTERVAL], p[StepIndex.COMPRESSOR_INTERVAL]
            opti.subject_to(
                opti.bounded(
                    -1.0,
                    (acceleration[k] - last_acceleration) / (limits.max_jerk_m_s3 * jerk_s),
                    1.0,
                )
            )
            largest = limits.max_compressor_rate_w_s / POWER_SCALE_W
            opti.subject_to(opti.bounded(-1.0, (power[k] - last_power) / (largest * rate_s), 1.0))
            last_acceleration, last_power = acceleration[k], power[k]
            speed = after[1]
            gap = p[StepIndex.LEADER_POSITION] - POSITION_SCALE_M * after[0]
            shortest = minimum_gap_m(speed, p[StepIndex.LEADER_SPEED], gap_policy, limits)
            short, long, fast, warm = (slacks[i, k] for i in range(layout.SLACKS))
            opti.subject_to(
                _least(gap - shortest, margins) + short >= 0.0,
            )
            opti.subject_to(_least(gap - gap_policy.standstill_gap_m, floors) + short >= 0.0)
            reserve = braking_reserve_m(
                gap, speed, acceleration[k], p[StepIndex.LEADER_SPEED], gap_policy, limits
            )
            at_end = p[StepIndex.END_OF_PREVIEW]
            opti.subject_to(at_end * reserve + (1.0 - at_end) * INACTIVE_ROW_M + short >= 0.0)
            opti.subject_to(gap - long <= gap_policy.max_gap_m)
            opti.subject_to(speed + fast >= limits.min_speed_m_s)
            opti.subject_to(speed - fast <= p[StepIndex.MAX_SPEED])
            for temperature_k in (WARM_K + after[2], WARM_K + after[3], outlet_k):
                opti.subject_to(temperature_k - warm <= limits.max_temperature_k)
            cost += stage_cost + cold_cost(length, WARM_K + after[2], shared)
            cost += shared[GlobalIndex.CELL_1_PRICE] * (after[2] - now[2])
            cost += shared[GlobalIndex.CELL_N_PRICE] * (after[3] - now[3])
            cost += length * (
                shared[GlobalIndex.COMPRESSOR_PRICE] * power[k]
                + weights.gap_short_1_m * short
                + weights.gap_long_1_m * long
                + weights.speed_1_m_s * fast
                + weights.temperature_1_k * warm
            )
        opti.minimize(cost)
        self._cost = cost

    def solve(self, data: ProblemData, guess: FloatArray) -> SolveResult:
        """Solve one problem from the same shifted guess that the controller uses."""
        states, inputs = self._grid.split(guess)
        began = time.perf_counter()
        opti = self._opti
        opti.set_value(self._parameters, data.parameters)
        opti.set_value(self._start, data.initial_state)
        opti.set_initial(self._states, states[:, :MOTION].T)
        opti.set_initial(self._acceleration, inputs[:, InputIndex.ACCELERATION])
        opti.set_initial(self._power, inputs[:, InputIndex.COMPRESSOR_POWER])
        opti.set_initial(self._slacks, inputs[:, InputIndex.GAP_SHORT :].T)
        answer = opti.solve_limited()
        values = [
            np.asarray(answer.value(part), dtype=float)
            for part in (self._states, self._acceleration, self._power, self._slacks)
        ]
        elapsed = time.perf_counter() - began
        stats = opti.stats()
        return SolveResult(
            status=SolveStatus.SOLVED if stats["success"] else SolveStatus.NUMERICAL_ERROR,
            reason=str(stats["return_status"]),
            variables=self._variables(data, values),
            objective=float(answer.value(self._cost)),
            iterations=int(stats["iter_count"]),
            time_s=elapsed,
            infeasibility=math.nan,
        )

    def _variables(self, data: ProblemData, values: list[FloatArray]) -> FloatArray:
        """Return the solution in the controller's order."""
        states, acceleration, power, slacks = (
            value.reshape(rows, -1)
            for value, rows in zip(values, (MOTION, 1, 1, layout.SLACKS), strict=True)
        )
        inputs = np.vstack([acceleration, power])
        last = np.hstack([data.initial_state[StateIndex.LAST_ACCELERATION :][:, None], inputs])
        return self._grid.join(np.vstack([states, last]).T, np.vstack([inputs, slacks]).T)


def _step_function(kind: StageKind, problem: OptimalControlProblem) -> ca.Function:
    """Return one step: state, inputs, samples and weights to its end state, cost and outlet temperature."""
    x, a, kilowatt = ca.SX.sym("x", MOTION), ca.SX.sym("a"), ca.SX.sym("p_cp")
    step_s, count, parameters = kind.step_s, kind.samples, problem.model
    samples = ca.SX.sym("samples", layout.SAMPLE_PARAMETERS * count)
    g = ca.SX.sym("g", layout.GLOBALS)
    channel = reduce_channel(parameters.cooling, parameters.pack)
    position, speed = POSITION_SCALE_M * x[0], x[1]
    first_k, last_k = WARM_K + x[2], WARM_K + x[3]
    now_1, now_n, end_1, end_n = first_k, last_k, first_k, last_k
    cost, outlet = ca.SX(0.0), ca.SX(0.0)
    rates = None
    margins, floors = [], []
    nodes, weights = quadrature(count)
    for i in range(count):
        elapsed_s, share_s = float(nodes[i]) * step_s, float(weights[i]) * step_s
        if rates is not None:
            now_1 = first_k + elapsed_s * rates.cell_1_temperature_rate_k_s
            now_n = last_k + elapsed_s * rates.cell_n_temperature_rate_k_s
        s = samples[layout.SAMPLE_PARAMETERS * i : layout.SAMPLE_PARAMETERS * (i + 1)]
        ahead = advance_position_m(position, speed, a, elapsed_s) - s[SampleIndex.POSITION]
        slope = (
            s[SampleIndex.SLOPE]
            + s[SampleIndex.SLOPE_GRADIENT] * ahead
            + 0.5 * s[SampleIndex.SLOPE_CURVATURE] * ahead * ahead
        )
        v = advance_speed_m_s(speed, a, elapsed_s)
        if step_s > LONGEST_STEP_WITHOUT_SAMPLED_GAP_S:
            gap = s[SampleIndex.LEADER_POSITION] - advance_position_m(position, speed, a, elapsed_s)
            shortest = minimum_gap_m(
                v, s[SampleIndex.LEADER_SPEED], parameters.gap, parameters.limits
            )
            margins.append(gap - shortest)
            floors.append(gap - parameters.gap.standstill_gap_m)
        cells = CellPair(now_1, now_n, g[GlobalIndex.CELL_1_LOSS], g[GlobalIndex.CELL_N_LOSS])
        rates = power_thermal_rates(
            v, a, slope, POWER_SCALE_W * kilowatt, cells, parameters, channel, problem.smoothing
        )
        reference = g[GlobalIndex.REFERENCE_TEMPERATURE]
        cost += share_s * (
            g[GlobalIndex.SPEED_WEIGHT] * (v - s[SampleIndex.SPEED_REFERENCE]) ** 2
            + g[GlobalIndex.TEMPERATURE_WEIGHT]
            * ((now_1 - reference) ** 2 + (now_n - reference) ** 2)
            + g[GlobalIndex.ENERGY_WEIGHT] * rates.battery_power_w
            + g[GlobalIndex.AGING_WEIGHT]
            * (rates.cell_1_capacity_loss_rate_1_s + rates.cell_n_capacity_loss_rate_1_s)
        )
        end_1 += share_s * rates.cell_1_temperature_rate_k_s
        end_n += share_s * rates.cell_n_temperature_rate_k_s
        outlet = rates.coolant.outlet_k
    end = ca.vertcat(
        advance_position_m(position, speed, a, step_s) / POSITION_SCALE_M,
        advance_speed_m_s(speed, a, step_s),
        end_1 - WARM_K,
        end_n - WARM_K,
    )
    inside = [ca.vertcat(*margins), ca.vertcat(*floors)]
    return ca.Function("step", [x, a, kilowatt, samples, g], [end, cost, outlet, *inside])


def _least(at_end: ca.MX, inside: ca.MX) -> ca.MX:
    """Return the smooth minimum of a margin at the end of a step and inside of it."""
    for index in range(inside.numel()):
        at_end = -maximum(-at_end, -inside[index], GAP_SMOOTHING_M)
    return at_end


def measure(problems: Path, count: int = 50) -> dict[str, float]:
    """Check on recorded problems that both formulations have the same optima.

    Args:
        problems: recorded problems (.npz).
        count: problems used.

    Raises:
        IptmError: the file cannot be read, or a set-up fails.
    """
    recorded = ProblemSet.load(problems)
    horizon, parameters = Horizon.parse(recorded.horizon), load_parameters().values
    peer = OptiPeer(OptimalControlProblem(horizon, parameters), tolerance=1e-8)
    ours = build_plain_solver(horizon, parameters, SolverOptions())
    differences = []
    for index in range(min(count, len(recorded))):
        data, guess = recorded.problem(index)
        theirs, mine = peer.solve(data, guess), ours.solve(data, guess)
        differences.append((theirs.objective - mine.objective) / max(1.0, abs(mine.objective)))
        print(
            f"{index:5d}  cost {mine.objective:14.8f}  peer - ours, relative {differences[-1]:+.1e}"
            f"  iterations {mine.iterations:3d} {theirs.iterations:3d}"
            f"  peer/ours time {theirs.time_s / mine.time_s:6.1f}"
        )
    return {"largest_relative_difference": float(np.max(np.abs(differences)))}


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
