"""Solutions are optimal: two solvers agree, and no feasible plan nearby is better.

The second judgement uses nothing of the solvers: inputs are changed at random, the states follow from
the stage functions, the slacks are the smallest that the limits ask for, and the cost is compared.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import astuple

import numpy as np
import pytest
from studies.speed.transcription import StageFunctions, Transcription
from tests.iptm_controller.scenes import (
    PARAMETERS,
    SCENES,
    check_in_python,
    checking_solver,
    plain_solver,
    problem_of,
    transcription_of,
)

from iptm_controller.measurements import Measurements
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.layout import InputIndex, LimitIndex, StepIndex
from iptm_controller.ocp.stage import DEFAULT_PENALTIES
from iptm_core.decision_record import SolveStatus
from iptm_core.state import FloatArray

ORDINARY = [
    "cooling",
    "cruise",
    "fast",
    "hills",
    "leader_brakes",
    "leader_pulls_away",
    "standstill",
]
INSIDE = 1e-8 * sum(astuple(DEFAULT_PENALTIES)) * 30.0
"""IPOPT widens bounds by 1e-8 and stops inside of its barrier: every slack costs that much per second."""
SLACK_ROWS = {
    InputIndex.GAP_SHORT: [LimitIndex.GAP_MIN, LimitIndex.GAP_FLOOR, LimitIndex.GAP_BRAKING],
    InputIndex.GAP_LONG: [LimitIndex.GAP_MAX],
    InputIndex.SPEED_EXCESS: [LimitIndex.SPEED_MIN, LimitIndex.SPEED_MAX],
    InputIndex.TEMPERATURE_EXCESS: list(range(LimitIndex.CELL_1_MAX, LimitIndex.OUTLET_MAX + 1)),
}
CHANGE_INTERVALS = [StepIndex.ACCELERATION_INTERVAL, StepIndex.COMPRESSOR_INTERVAL]


class Rollout:
    """The problem as a function of accelerations and compressor powers alone."""

    def __init__(self, transcription: Transcription, data: ProblemData) -> None:
        self._data = data
        self._stages: list[StageFunctions] = [
            stage
            for stage, kind in zip(transcription.stages, transcription.grid.stages, strict=True)
            for _ in range(kind.count)
        ]
        self._places = transcription.grid.step_parameters
        limits = PARAMETERS.limits
        self._low = np.array([limits.min_acceleration_m_s2, limits.min_compressor_power_w / 1e3])
        self._high = np.array([limits.max_acceleration_m_s2, limits.max_compressor_power_w / 1e3])
        self._rates = np.array([limits.max_jerk_m_s3, limits.max_compressor_rate_w_s / 1e3])

    def cost(self, wanted: FloatArray) -> float:
        """Cost of inputs, shape (N, 2), after they are brought within bounds and rates."""
        state = self._data.initial_state
        total = 0.0
        for stage, place, inputs in zip(self._stages, self._places, wanted, strict=True):
            p = self._data.parameters[place]
            step = self._rates * p[CHANGE_INTERVALS]
            last = state[4:6]
            bounded = np.clip(np.clip(inputs, self._low, self._high), last - step, last + step)
            u = np.concatenate([bounded, np.zeros(layout.SLACKS)])
            arguments = (p, self._data.parameters[: layout.GLOBALS])
            limits = stage.value(state, u, *arguments)[0].full().ravel()[layout.STATES :]
            for slack, rows in SLACK_ROWS.items():
                u[slack] = max(0.0, -limits[rows].min())
            rows, cost = stage.value(state, u, *arguments)
            state = -rows.full().ravel()[: layout.STATES]
            total += float(cost)
        return total


def inputs_of(variables: FloatArray) -> FloatArray:
    table = variables[: -layout.STATES].reshape(-1, layout.BLOCK)
    return table[:, layout.STATES : layout.STATES + 2].copy()


def changes(steps: int) -> Iterator[FloatArray]:
    """Small and large, at one step, on all alike, and everywhere at random."""
    rng = np.random.default_rng(11)
    for size in (1e-3, 1e-2, 0.1, 0.5):
        for step in range(steps):
            for index in range(2):
                for sign in (-1.0, 1.0):
                    single = np.zeros((steps, 2))
                    single[step, index] = sign * size
                    yield single
        for _ in range(12):
            yield np.tile(rng.normal(scale=size, size=2), (steps, 1))
            yield rng.normal(scale=size, size=(steps, 2))


@pytest.mark.parametrize("strategy", ["aging", "reference_energy_aging"])
@pytest.mark.parametrize("name", ORDINARY)
def test_the_reference_solver_finds_nothing_better(name: str, strategy: str) -> None:
    """The reference may end in another local minimum, never in a lower one, and it stays in ours."""
    data, guess = problem_of(SCENES[name], "3x1+5x5", strategy)
    default = checking_solver("3x1+5x5").solve(data, guess)
    elsewhere = check_in_python(plain_solver("3x1+5x5", "ipopt")).solve(data, guess)
    from_ours = plain_solver("3x1+5x5", "ipopt").solve(data, default.variables)
    assert default.status is SolveStatus.SOLVED
    assert elsewhere.status is SolveStatus.SOLVED
    assert from_ours.status is SolveStatus.SOLVED
    # Where s_min and jerk bind together, the two stop up to some ten-thousandths of the cost apart.
    apart = INSIDE + 5e-4 * abs(elsewhere.objective)
    assert default.objective <= elsewhere.objective + apart
    assert default.objective == pytest.approx(from_ours.objective, rel=0.0, abs=apart)
    difference = np.abs(inputs_of(default.variables) - inputs_of(from_ours.variables))
    assert difference[0].max() < 0.1


def test_the_same_optimum_on_the_single_horizon(ordinary_scene: Measurements) -> None:
    problem = problem_of(ordinary_scene, "15x1", "aging")
    default = plain_solver("15x1").solve(*problem)
    ipopt = plain_solver("15x1", "ipopt").solve(*problem)
    assert default.status is SolveStatus.SOLVED
    assert ipopt.status is SolveStatus.SOLVED
    assert default.objective == pytest.approx(ipopt.objective, rel=1e-5, abs=INSIDE)


@pytest.mark.parametrize(
    ("name", "strategy"),
    [
        *((name, "aging") for name in ORDINARY),
        ("hills", "reference"),
        ("leader_brakes", "energy_aging"),
        ("cooling", "reference_energy_aging"),
    ],
)
def test_no_feasible_plan_nearby_is_better(name: str, strategy: str) -> None:
    data, guess = problem_of(SCENES[name], "3x1+5x5", strategy)
    result = checking_solver("3x1+5x5").solve(data, guess)
    rollout = Rollout(transcription_of("3x1+5x5"), data)
    best = inputs_of(result.variables)
    tolerance = 1e-3 + 1e-4 * abs(result.objective)
    # The roll-out agrees with the solver, so the two costs may be compared.
    assert rollout.cost(best) == pytest.approx(result.objective, abs=tolerance)
    for change in changes(best.shape[0]):
        # Not a number where the pack cannot deliver what the change asks for.
        assert not rollout.cost(best + change) < result.objective - tolerance


def test_solutions_are_feasible(ordinary_scene: Measurements) -> None:
    """Checked on an evaluation of its own, not on what the solver reports."""
    data, guess = problem_of(ordinary_scene, "3x1+5x5", "aging")
    result = plain_solver("3x1+5x5").solve(data, guess)
    transcription = transcription_of("3x1+5x5")
    nodes, inputs = transcription.grid.split(result.variables)
    np.testing.assert_allclose(nodes[0], data.initial_state, atol=1e-7)
    for stage, kind in zip(transcription.stages, transcription.grid.stages, strict=True):
        for step in range(kind.steps.start, kind.steps.stop):
            p = data.parameters[transcription.grid.step_parameters[step]]
            u = inputs[step]
            rows, _ = stage.value(nodes[step], u, p, data.parameters[: layout.GLOBALS])
            values = rows.full().ravel()
            np.testing.assert_allclose(nodes[step + 1], -values[: layout.STATES], atol=1e-5)
            limits = values[layout.STATES :]
            assert np.abs(limits[: LimitIndex.GAP_MIN]).max() <= 1.0 + 1e-5
            assert limits[LimitIndex.GAP_MIN :].min() >= -1e-5
            assert -2.0 - 1e-6 <= u[0] <= 2.0 + 1e-6
            assert -1e-6 <= u[1] <= 4.5 + 1e-6
            assert u[2:].min() >= -1e-6
    assert result.infeasibility <= 1e-5
