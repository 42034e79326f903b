"""Puts measured tables into docs/v2x.md, from the --json files of the other v2x parts."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from benchmarks import v2x_attacks, v2x_impostors, v2x_prediction
from benchmarks.harness import put, run_benchmark
from benchmarks.v2x_price import PAGE


def fuzz_text(numbers: dict[str, Any]) -> str:
    """Return a sentence on what became of damaged datagrams."""
    outcomes = ", ".join(f"`{name}` {count}" for name, count in numbers["outcomes"].items())
    return (
        f"{numbers['datagrams']} damaged or invented datagrams: {outcomes}. The slowest took "
        f"{numbers['slowest_ms']:.1f} ms of processor time; memory grew by "
        f"{numbers['grown_mib']:.1f} MiB."
    )


def load_text(numbers: dict[str, Any]) -> str:
    """Return a sentence on a crowd of cars."""
    first = numbers["ticks"] - numbers["ticks_with_a_leader"]
    return (
        f"The node under {numbers['datagrams_per_s']:.0f} datagrams a second of {numbers['stations']} cars "
        f"for {numbers['ticks']} s: {numbers['read']} of {numbers['sent']} read, {numbers['accepted']} "
        f"accepted, at {100.0 * numbers['share_of_a_core']:.0f} % of a processor core. Ticks without a "
        f"leader, which has to be heard for a moment first: {first}."
    )


def flood_text(numbers: dict[str, Any]) -> str:
    """Return a sentence on a flood of maps."""
    beside = f", beside {numbers['loops_beside']} closed loop in real time"
    return (
        f"A flood of {numbers['maps_per_s']} maps of 1.3 kB a second for {numbers['ticks']} s on top of "
        f"{numbers['stations'] * 10} messages of cars a second{beside}: {numbers['accepted']} of "
        f"{numbers['cams_sent']} messages of cars accepted, {numbers['ticks_answered']} of "
        f"{numbers['ticks']} ticks answered, the slowest after "
        f"{1e3 * numbers['slowest_answer_s']:.0f} ms, at {100.0 * numbers['share_of_a_core']:.0f} % of a "
        f"processor core. {numbers['refused'].get('waited', 0)} maps were dropped while others were decoded."
    )


TEXTS = {
    "prediction": v2x_prediction.as_table,
    "fuzz": fuzz_text,
    "attacks": v2x_attacks.as_table,
    "impostors": v2x_impostors.as_table,
    "load": load_text,
    "flood": flood_text,
}


def measure(
    prediction: str = "",
    fuzz: str = "",
    attacks: str = "",
    impostors: str = "",
    load: str = "",
    flood: str = "",
) -> dict[str, Any]:
    """Write the page.

    Args:
        prediction: numbers of v2x_prediction.
        fuzz: numbers of v2x_fuzz.
        attacks: numbers of v2x_attacks.
        impostors: numbers of v2x_impostors.
        load: numbers of v2x_load.
        flood: numbers of v2x_load with maps_per_s.
    """
    page = PAGE.read_text(encoding="utf-8")
    files = {
        "prediction": prediction,
        "fuzz": fuzz,
        "attacks": attacks,
        "impostors": impostors,
        "load": load,
        "flood": flood,
    }
    for name, file in files.items():
        if file:
            numbers = json.loads(Path(file).read_text(encoding="utf-8"))
            page = put(page, name, TEXTS[name](numbers))
    PAGE.write_text(page, encoding="utf-8")
    return {"written": [name for name, file in files.items() if file]}


if __name__ == "__main__":
    sys.exit(run_benchmark(measure))
