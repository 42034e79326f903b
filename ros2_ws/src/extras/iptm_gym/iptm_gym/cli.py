"""The command `learn`: its arguments, and the generations as they pass."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from iptm_core.program import EXIT_OK, refused

PROGRAM = "iptm learn"
GENERATIONS = 150


def main(arguments: Sequence[str] | None = None) -> int:
    """Learn a policy.

    Returns:
        0 on success, 2 when the file cannot be written.
    """
    parser = argparse.ArgumentParser(
        PROGRAM,
        description="Learn a small policy of motion and cooling by an evolution strategy on synthetic trips, "
        "and write its weights with their digest. The same seed gives the same policy.",
    )
    parser.add_argument("policy", type=Path, help="JSON file that is written")
    parser.add_argument(
        "--generations", type=int, default=GENERATIONS, metavar="N", help=f"({GENERATIONS})"
    )
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the trips (1)")
    given = parser.parse_args(arguments)
    if given.generations < 1:
        return refused(PROGRAM, f"--generations is {given.generations}; allowed: 1 or more")
    # Numerical libraries are loaded once the arguments are known: help is answered without them.
    from iptm_gym.learning import generations  # noqa: PLC0415

    for each in islice(generations(given.seed), given.generations):
        if each.number % 20 == 0 or each.number == given.generations:
            print(f"generation {each.number}: {100.0 * each.eur_km:.3f} EUR/100 km", flush=True)
    try:
        each.policy.write(given.policy)
    except OSError as error:
        return refused(PROGRAM, f"cannot be written: {error}")
    print(f"digest {each.policy.digest}")
    return EXIT_OK
