"""Tiny comparisons: that they count and judge rightly. Speed is not tested."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from benchmarks import compare_solvers, peer_opti
from benchmarks.compare_solvers import compare, comparison_table
from benchmarks.contenders import INTERPRETED, PEER, PEER_EXPANDED, build_contender
from benchmarks.harness import run_benchmark
from benchmarks.kkt import KktChecker
from benchmarks.peer_opti import OptiPeer
from benchmarks.record_problems import ProblemSet, record_problems

from iptm_controller.horizon import Horizon
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.solvers.factory import build_plain_solver
from iptm_controller.solvers.interface import SolverOptions
from iptm_core.decision_record import SolveStatus
from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters

PARAMETERS = load_parameters().values


@pytest.fixture(scope="module")
def problems() -> ProblemSet:
    return record_problems("us06", "aging", "2x1+2x5", first_tick=60, count=6)


def test_the_peer_finds_the_same_optimum(problems: ProblemSet) -> None:
    horizon = Horizon.parse(problems.horizon)
    peer = OptiPeer(OptimalControlProblem(horizon, PARAMETERS), tolerance=1e-8)
    options = SolverOptions(name="ipopt", compile_code=False, tolerance=1e-8)
    ours = build_plain_solver(horizon, PARAMETERS, options)
    checker = KktChecker(OptimalControlProblem(horizon, PARAMETERS))
    for index in range(len(problems)):
        data, guess = problems.problem(index)
        theirs = peer.solve(data, guess)
        assert theirs.status is SolveStatus.SOLVED
        # Both widen bounds by 1e-8, and every slack of a soft limit is priced.
        assert theirs.objective == pytest.approx(
            ours.solve(data, guess).objective, rel=1e-5, abs=4e-3
        )
        assert checker.residual(data, theirs.variables).worst < 1e-4


def test_a_comparison_counts_every_problem_once(problems: ProblemSet) -> None:
    names = (INTERPRETED, PEER, PEER_EXPANDED)
    rows = compare(problems, names, blocks=2, block_length=2, kkt_every=1)
    assert [row["name"] for row in rows] == list(names)
    for row in rows:
        assert row["problems"] == 4
        assert row["unconverged"] == row["unusable"] == row["other_optimum"] == 0
        assert row["kkt_max"] < 1e-3
        assert 0.0 < row["median_ms"] <= row["p99_ms"] <= row["max_ms"]
    assert rows[1]["peer_by_median"] == pytest.approx(1.0)
    text = comparison_table(rows)
    assert len({line.count("|") for line in text.splitlines()}) == 1


def test_without_the_peer_there_is_no_ratio(problems: ProblemSet) -> None:
    (row,) = compare(problems, (INTERPRETED,), blocks=1, block_length=1, kkt_every=0)
    assert row["peer_by_median"] is None
    assert np.isnan(row["kkt_max"])


def test_unknown_contenders_are_refused() -> None:
    with pytest.raises(ScenarioError, match="abacus"):
        build_contender("abacus", Horizon.parse("2x1"), PARAMETERS)


def test_the_commands_work_on_a_file(
    problems: ProblemSet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, numbers = tmp_path / "set.npz", tmp_path / "out" / "numbers.json"
    problems.save(path)
    short = ["--solver", INTERPRETED, "--blocks", "1", "--block-length", "1"]
    arguments = [str(path), *short, "--json", str(numbers)]
    assert run_benchmark(compare_solvers.measure, arguments, compare_solvers.tables) == 0
    assert f"`{INTERPRETED}`" in capsys.readouterr().out
    ((row,),) = json.loads(numbers.read_text()).values()
    assert row["problems"] == 1
    assert run_benchmark(peer_opti.measure, [str(path), "--count", "1"]) == 0
    assert run_benchmark(compare_solvers.measure, [str(tmp_path / "missing.npz")]) == 2
    assert "missing.npz" in capsys.readouterr().err
