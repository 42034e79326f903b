"""The default solver and others on the same problems: time, failures, and better minima of another one.

    python -m studies.speed.peers

Problems are those of a trip; every solver begins at the shifted plan and takes its turn on each of them. All
but ours are CasADi's, on the same functions in machine code.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from studies.speed.harness import machine_in_words, run_benchmark
from studies.speed.transcription import Transcription, problem_bounds, transcribe

from iptm.closed_loop import run_closed_loop
from iptm_controller.controller import MpcController
from iptm_controller.horizon import MULTI_HORIZON, Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.data import ProblemData
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.ocp.stage import DEFAULT_SMOOTHING
from iptm_controller.options import ControllerOptions
from iptm_controller.solvers.factory import build_solver
from iptm_controller.solvers.interface import SolverBackend
from iptm_controller.solvers.riccati.backend import RiccatiBackend
from iptm_controller.solvers.switching_check import SwitchingCheck
from iptm_controller.strategy import DEFAULT_STRATEGY, strategy_by_name
from iptm_core.compilation import compile_sources
from iptm_core.decision_record import SolveStatus
from iptm_core.errors import SolverSetupError
from iptm_core.markdown import table_of
from iptm_core.parameters import load_parameters
from iptm_core.physics.cell import nominal_charge_parameters
from iptm_core.physics.ops import named_function
from iptm_core.routes import build_route
from iptm_core.state import FloatArray
from iptm_plant_sim.plant import Plant

OURS, CHECKED = "riccati", "riccati, switching check"
SIMULATED = "riccati, other cooling simulated"
BETTER_BY = 1e-3
"""A cost that is higher than the best one by more is another local minimum."""
TOLERANCE, BARRIER, FEASIBLE = 1e-5, 1e-4, 1e-4
Answer = tuple[float, int, bool]
"""Cost, iterations, and whether the problem is solved."""
Solve = Callable[[ProblemData, FloatArray], Answer]


@dataclass(frozen=True)
class Recorded:
    """A problem of a trip, the guess that its solve began at, and the solves since the last second one."""

    data: ProblemData
    guess: FloatArray
    since_second: int | None


def recorded(
    cycle: str, ticks: int, controller: MpcController, backend: SwitchingCheck
) -> list[Recorded]:
    """Drive a trip and return the problems of its ticks."""
    problems: list[Recorded] = []
    solve = backend.solve

    def noted(data: ProblemData, guess: FloatArray, **given: Any) -> Any:
        problems.append(Recorded(data, guess.copy(), backend.since_second))
        return solve(data, guess, **given)

    backend.solve = noted  # type: ignore[method-assign]
    parameters = load_parameters().values
    route = build_route(cycle, initial_gap_m=parameters.gap.initial_gap_m, duration_s=float(ticks))
    run_closed_loop(route, Plant(parameters, route.slope.slope_at), controller)
    backend.solve = solve  # type: ignore[method-assign]
    return problems


def compiled(functions: Sequence[ca.Function]) -> Path:
    """Return the library of functions, as CasADi writes them."""
    generator = ca.CodeGenerator("problem.c", {"with_header": False})
    for function in functions:
        generator.add(function)
    return compile_sources({"problem.c": generator.dump()})


def casadi_solvers(problem: OptimalControlProblem) -> dict[str, Solve]:
    """Return CasADi's solvers by name, those that are part of the installed CasADi."""
    transcription = transcribe(problem)
    steps = problem.grid.steps
    sizes = {
        "N": steps,
        "nx": [layout.STATES] * (steps + 1),
        "nu": [layout.INPUTS] * steps + [0],
        "ng": [layout.ROWS - layout.STATES] * steps + [0],
    }
    equality = [True] * layout.STATES + [False] * (layout.ROWS - layout.STATES)
    inner = {"tol": TOLERANCE, "mu_init": BARRIER, "max_iter": 150, "print_level": 0}
    fatrop = {
        "structure_detection": "manual",
        **sizes,
        "equality": equality * steps,
        "fatrop": inner,
    }
    sqp = {
        "max_iter": 50,
        "max_iter_ls": 3,
        "tol_pr": TOLERANCE,
        "tol_du": 1e-4,
        "hessian_approximation": "exact",
        "convexify_strategy": "regularize",
        "print_header": False,
        "print_iteration": False,
        "print_status": False,
    }
    quiet = {"error_on_fail": False, "print_time": False}
    plugins: dict[str, tuple[str, dict[str, Any]]] = {
        "Fatrop": ("fatrop", fatrop),
        "IPOPT with MUMPS": ("ipopt", {"ipopt": {**inner, "sb": "yes", "bound_relax_factor": 0.0}}),
        "SQP with HPIPM": (
            "sqpmethod",
            {**sqp, "qpsol": "hpipm", "qpsol_options": {**quiet, **sizes}},
        ),
        "SQP with PIQP": ("sqpmethod", {**sqp, "qpsol": "piqp", "qpsol_options": quiet}),
    }
    oracles = {
        "ipopt": transcription.functions(),
        "fatrop": _oracle(transcription, whole=False),
        "sqpmethod": _oracle(transcription, whole=True),
    }
    libraries = {plugin: str(compiled(functions)) for plugin, functions in oracles.items()}
    found = {}
    for name, (plugin, options) in plugins.items():
        options |= {"print_time": False, "record_time": False, "error_on_fail": False}
        try:
            solver = ca.nlpsol("peer", plugin, libraries[plugin], options)
        except RuntimeError as error:
            print(f"{name} is left out: {str(error).splitlines()[-1]}", file=sys.stderr)
            continue
        found[name] = _solve_with(solver, transcription, problem)
    return found


def _oracle(transcription: Transcription, *, whole: bool) -> list[ca.Function]:
    """Return the functions of a problem by the names that CasADi's solvers ask for.

    Args:
        whole: the Hessian of the Lagrangian alone; Fatrop takes its gradient with it.
    """
    t = transcription
    cost, rows = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", t.rows.numel())
    point, weights = {"x": t.variables, "p": t.parameters}, {"lam_f": cost, "lam_g": rows}
    hessian = {"hess_gamma_x_x": t.hessian(cost, rows)}
    gradient = {"grad_gamma_x": cost * t.gradient + ca.mtimes(t.jacobian.T, rows)}
    results: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
        "nlp": (point, {"f": t.cost, "g": t.rows}),
        "nlp_f": (point, {"f": t.cost}),
        "nlp_g": (point, {"g": t.rows}),
        "nlp_fg": (point, {"f": t.cost, "g": t.rows}),
        "nlp_grad_f": (point, {"grad_f_x": t.gradient}),
        "nlp_gf_jg": (point, {"grad_f_x": t.gradient, "jac_g_x": t.jacobian}),
        "nlp_jac_g": (point, {"g": t.rows, "jac_g_x": t.jacobian}),
        "nlp_jac_fg": (
            point,
            {"f": t.cost, "grad_f_x": t.gradient, "g": t.rows, "jac_g_x": t.jacobian},
        ),
        "nlp_grad": (
            point | weights,
            {
                "f": t.cost,
                "g": t.rows,
                **gradient,
                "grad_gamma_p": ca.MX.zeros(t.parameters.numel()),
            },
        ),
        "nlp_hess_l": (point | weights, hessian if whole else gradient | hessian),
    }
    return [named_function(name, *each) for name, each in results.items()]


def _solve_with(
    solver: ca.Function, transcription: Transcription, problem: OptimalControlProblem
) -> Solve:
    point = transcription.variables, transcription.parameters
    evaluate = ca.Function("evaluate", point, (transcription.cost, transcription.rows))
    bounds = problem_bounds(problem.grid.steps, problem.model)

    def solve(data: ProblemData, guess: FloatArray) -> Answer:
        start, low, high = guess.copy(), bounds.variables_low.copy(), bounds.variables_high.copy()
        for each in (start, low, high):
            each[: layout.STATES] = data.initial_state
        try:
            found = solver(
                x0=start,
                p=data.parameters,
                lbx=low,
                ubx=high,
                lbg=bounds.rows_low,
                ubg=bounds.rows_high,
            )
        except RuntimeError:
            return np.nan, 0, False
        # Bounds are relaxed by 1e-8: slacks below zero, at their high prices, would lower the cost by 0.003.
        cost, rows = evaluate(np.clip(np.ravel(found["x"]), low, high), data.parameters)
        values = np.ravel(rows)
        violation = float(
            np.max([bounds.rows_low - values, values - bounds.rows_high], initial=0.0)
        )
        stats = solver.stats()
        return (
            float(cost),
            int(stats["iter_count"]),
            bool(stats["success"]) and violation <= FEASIBLE,
        )

    return solve


def peers(cycle: str = "comprehensive", ticks: int = 10000, problems: int = 150) -> dict[str, Any]:
    """Time all solvers on problems of a trip.

    Args:
        cycle: trip that the problems are of.
        ticks: length of the trip in seconds.
        problems: how many of them are solved, chosen at random.
    """
    parameters = load_parameters().values
    options = ControllerOptions(strategy=strategy_by_name(DEFAULT_STRATEGY), horizon=MULTI_HORIZON)
    controller = MpcController(parameters, options)
    check = controller.backend
    if not isinstance(check, SwitchingCheck):
        raise SolverSetupError("the default strategy has no check of the switching")
    found = recorded(cycle, ticks, controller, check)
    chosen = np.random.default_rng(1).choice(len(found), min(problems, len(found)), replace=False)
    some = [found[place] for place in sorted(chosen.tolist())]
    problem = OptimalControlProblem(
        Horizon.parse(str(MULTI_HORIZON)), nominal_charge_parameters(parameters), DEFAULT_SMOOTHING
    )
    simulating = build_solver(
        MULTI_HORIZON, problem.model, replace(options.solver, simulate_cooling=True)
    )
    checks = [check, simulating]
    plain = RiccatiBackend(problem, options.solver)
    backends: dict[str, SolverBackend] = {OURS: plain, CHECKED: check, SIMULATED: checks[1]}
    solvers = {name: _answers_of(each) for name, each in backends.items()}
    solvers |= casadi_solvers(problem)
    rows = _measured(some, solvers, checks)
    return {"machine": machine_in_words(), "problems": len(some), "rows": rows}


def _answers_of(backend: SolverBackend) -> Solve:
    def solve(data: ProblemData, guess: FloatArray) -> Answer:
        result = backend.solve(data, guess)
        return result.objective, result.iterations, result.status is SolveStatus.SOLVED

    return solve


def _measured(
    problems: Sequence[Recorded], solvers: dict[str, Solve], checks: Sequence[SwitchingCheck]
) -> list[dict[str, Any]]:
    times: dict[str, list[float]] = {name: [] for name in solvers}
    answers: dict[str, list[Answer]] = {name: [] for name in solvers}
    for place, each in enumerate(problems):
        # Who comes first in a turn finds the caches of the processor as the one before has left them.
        first = place % len(solvers)
        for name, solve in [*solvers.items()][first:] + [*solvers.items()][:first]:
            for check in checks:
                check.since_second = each.since_second
            began = time.process_time()
            answers[name].append(solve(each.data, each.guess))
            times[name].append(1e3 * (time.process_time() - began))
    costs = np.array(
        [[cost if ok else np.inf for cost, _, ok in found] for found in answers.values()]
    )
    best = costs.min(axis=0)
    above = (costs - best) / np.maximum(np.abs(best), 1e-9)
    return [
        {
            "solver": name,
            "median": float(np.median(times[name])),
            "p99": float(np.quantile(times[name], 0.99)),
            "iterations": float(np.median([count for _, count, _ in answers[name]])),
            "failed": sum(not ok for *_, ok in answers[name]),
            "other": int(np.count_nonzero(np.isfinite(costs[place]) & (above[place] > BETTER_BY))),
        }
        for place, name in enumerate(solvers)
    ]


def as_text(numbers: dict[str, Any]) -> str:
    """Return the table of the page."""
    columns = {
        "solver": "{solver}",
        "median ms:": "{median:.2f}",
        "99th percentile ms:": "{p99:.1f}",
        "iterations:": "{iterations:.0f}",
        f"failed of {numbers['problems']}:": "{failed}",
        "another minimum is better:": "{other}",
    }
    return f"{numbers['machine']}\n\n{table_of(numbers['rows'], columns)}"


if __name__ == "__main__":
    sys.exit(run_benchmark(peers, text_of=as_text))
