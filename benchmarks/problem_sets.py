"""Recorded sequences of optimal control problems, as files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iptm_controller.ocp.data import ProblemData
from iptm_core.errors import ScenarioError
from iptm_core.state import FloatArray

FORMAT = 1


@dataclass(frozen=True)
class ProblemSet:
    """Consecutive problems of one closed loop.

    Attributes:
        cycle: driving cycle.
        strategy: name of the strategy.
        horizon: grid, such as ``3x1+5x5``.
        first_tick: tick of the first problem.
        guesses: shifted plans, scaled units, shape (n, variables).
        initial_states: shape (n, 6).
        parameters: shape (n, parameters).
    """

    cycle: str
    strategy: str
    horizon: str
    first_tick: int
    guesses: FloatArray
    initial_states: FloatArray
    parameters: FloatArray

    def __len__(self) -> int:
        return int(self.guesses.shape[0])

    def problem(self, index: int) -> tuple[ProblemData, FloatArray]:
        """Return data and guess of one problem."""
        data = ProblemData(self.initial_states[index], self.parameters[index])
        return data, self.guesses[index]

    def save(self, path: Path) -> None:
        """Write the set as a compressed archive."""
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(
            path,
            format=FORMAT,
            cycle=self.cycle,
            strategy=self.strategy,
            horizon=self.horizon,
            first_tick=self.first_tick,
            guesses=self.guesses,
            initial_states=self.initial_states,
            parameters=self.parameters,
        )

    @classmethod
    def load(cls, path: Path) -> ProblemSet:
        """Read a set.

        Raises:
            ScenarioError: the file cannot be read or is of another format.
        """
        try:
            with np.load(path, allow_pickle=False) as archive:
                if int(archive["format"]) != FORMAT:
                    raise ScenarioError(
                        f"problem set '{path.name}' has format {int(archive['format'])}, "
                        f"allowed is {FORMAT}; record it anew"
                    )
                return cls(
                    cycle=str(archive["cycle"]),
                    strategy=str(archive["strategy"]),
                    horizon=str(archive["horizon"]),
                    first_tick=int(archive["first_tick"]),
                    guesses=archive["guesses"],
                    initial_states=archive["initial_states"],
                    parameters=archive["parameters"],
                )
        except (OSError, ValueError, KeyError) as error:
            raise ScenarioError(f"problem set '{path.name}' cannot be read: {error}") from error


@dataclass(frozen=True)
class Block:
    """A stretch of consecutive problems, ``start`` to ``stop - 1``; nothing is carried into it."""

    start: int
    stop: int


def spread_blocks(total: int, blocks: int, length: int) -> list[Block]:
    """Return stretches of equal length, evenly spread over ``total`` problems.

    Args:
        total: number of problems.
        blocks: number of stretches.
        length: problems per stretch.

    Returns:
        The stretches in order, never overlapping; as many as fit if more are asked for.
    """
    length = min(length, total)
    blocks = min(blocks, total // length)
    starts = np.linspace(0, total - length, blocks).astype(int)
    return [Block(int(start), int(start) + length) for start in starts]
