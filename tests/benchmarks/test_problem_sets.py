from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from benchmarks.record_problems import ProblemSet, record_problems, spread_blocks

from iptm_core.errors import ScenarioError


@pytest.fixture(scope="module")
def recorded() -> ProblemSet:
    return record_problems("nycc", "aging", "2x1+1x5", first_tick=3, count=4)


def test_a_recording_has_what_was_asked_for(recorded: ProblemSet) -> None:
    assert len(recorded) == 4
    assert recorded.horizon == "2x1+1x5"
    assert recorded.guesses.shape == (4, 12 * 3 + 6)
    data, guess = recorded.problem(2)
    np.testing.assert_array_equal(data.initial_state, guess[:6])


def test_a_set_survives_its_file(recorded: ProblemSet, tmp_path: Path) -> None:
    recorded.save(tmp_path / "folder" / "set.npz")
    loaded = ProblemSet.load(tmp_path / "folder" / "set.npz")
    found = (loaded.cycle, loaded.strategy, loaded.horizon, loaded.first_tick)
    assert found == ("nycc", "aging", "2x1+1x5", 3)
    np.testing.assert_array_equal(loaded.guesses, recorded.guesses)
    np.testing.assert_array_equal(loaded.parameters, recorded.parameters)


def test_other_files_are_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    path.write_text("no archive")
    with pytest.raises(ScenarioError, match=r"other\.npz"):
        ProblemSet.load(path)
    with pytest.raises(ScenarioError, match=r"missing\.npz"):
        ProblemSet.load(tmp_path / "missing.npz")


@pytest.mark.parametrize(
    ("total", "blocks", "length", "expected"),
    [
        (100, 3, 10, [range(10), range(45, 55), range(90, 100)]),
        (5, 3, 10, [range(5)]),
        (25, 9, 10, [range(10), range(15, 25)]),
    ],
)
def test_stretches_fit_and_do_not_overlap(
    total: int, blocks: int, length: int, expected: list[range]
) -> None:
    assert spread_blocks(total, blocks, length) == expected
