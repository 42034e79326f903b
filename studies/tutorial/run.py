"""The figures of the tutorial: its command lines, driven without ROS, against the reference and `BASES`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace

import pandas as pd
from studies.savings import BASES, COLUMNS, PREVIEWS, road_taken
from studies.session import Session

import iptm
from iptm.commands.run import build_parser, chosen_trip, parsed_options
from iptm.parts import Trajectory

COMMANDS = (
    "scripts/run_demo",
    "scripts/run_demo --overrides gap.max_gap_m=80",
    "scripts/run_demo --strategy aging",
    "scripts/run_demo --cycle us06 --slope large --duration-s 1200",
    (
        "scripts/run_demo --cycle us06 --slope large --duration-s 1200 --horizon 3x1+5x5+10x30t"
        " --set leader.preview_length_s=330"
    ),
    (
        "scripts/run_demo imperfect_preview --set leader.dropout_probability=0.5 --set leader.latency_s=3"
        " --set leader.noise_std_m_s=1.5 --set leader.seed=7"
    ),
)
"""As the tutorial shows them; a test compares."""
SHORT_S = 60.0
LENGTHS_S = (120.0, 300.0, 600.0, 1200.0)
_CUT_COLUMNS = {
    "after (s):": "{length_s:.0f}",
    "ageing saved, as driven:": "{as_driven:.1f} %",
    "with equal ends:": "{equal_ends:.1f} %",
    "": "{judgement}",
}
_COLUMNS = {
    "command": "`{command}`",
    **dict(COLUMNS[:5]),
    "ageing saved": "{aging}",
    "energy saved": "{energy}",
    **{f"against `{name}`, ageing / energy": f"{{{name}}}" for name in BASES},
    "capacity lost (ppm):": "{own_ppm:.2f}",
    "of the reference (ppm):": "{other_ppm:.2f}",
}
AGAINST = ("reference", *BASES)


def drive_command(command: str, against: str = "", duration_s: float | None = None) -> iptm.Run:
    """Drive the trip of a command line in memory, or the one that it is compared with."""
    trip = chosen_trip(parsed_options(build_parser(), shlex.split(command)[1:]))
    if duration_s is not None:
        trip = trip.changed(duration_s=duration_s)
    return iptm.drive(trip.against(against) if against else trip)


def _preview(command: str) -> str:
    """Return how far ahead a command line sees, and how well."""
    _, _, stated = command.partition("preview_length_s=")
    foreseen = f"{stated} s, perfect" if stated else PREVIEWS[True]
    return foreseen.replace("perfect", "imperfect") if "imperfect" in command else foreseen


def rows(runs: Sequence[iptm.Run], others: Sequence[Sequence[iptm.Run]]) -> pd.DataFrame:
    """Return a row per command, of its run and those that it is compared with, one per `AGAINST`."""
    return pd.DataFrame(
        {
            "command": command,
            "distance": f"{run.parameters.gap.max_gap_m:g} m",
            "preview": _preview(command),
            **road_taken([run.trajectory]),
            "aging": f"{found.aging.text} ({found.aging.as_driven})",
            "energy": f"{found.energy.text} ({found.energy.as_driven})",
            **{
                name: " / ".join(saving.text for saving in (base.aging, base.energy))
                for name, base in zip(BASES, bases, strict=True)
            },
            "own_ppm": run.figures["total_degradation"],
            "other_ppm": other[0].figures["total_degradation"],
        }
        for command, run, other in zip(COMMANDS, runs, others, strict=True)
        for found, *bases in [[run.saving(each) for each in other]]
    )


def cut_short(run: iptm.Run, other: iptm.Run) -> pd.DataFrame:
    """Return the savings after parts of a trip, a row each."""

    def until(of: iptm.Run, last_s: float) -> iptm.Run:
        driven = of.trajectory.to_arrays()
        kept = driven["time_s"] <= last_s
        return replace(
            of,
            trajectory=Trajectory.from_arrays({name: each[kept] for name, each in driven.items()}),
        )

    last_s = float(run.trajectory.time_s[-1])
    lengths_s = [*(length_s for length_s in LENGTHS_S if length_s < last_s), last_s]
    savings = [until(run, length_s).saving(until(other, length_s)) for length_s in lengths_s]
    return pd.DataFrame(
        {
            "length_s": length_s,
            "as_driven": found.aging.as_driven_percent,
            "equal_ends": found.aging.equal_ends_percent,
            "judgement": str(found.aging.judgement),
        }
        for length_s, found in zip(lengths_s, savings, strict=True)
    )


def run(session: Session) -> bool:
    """Run the study; returns whether every trip was driven."""
    extent = {"duration_s": SHORT_S} if session.short else {}
    commands = [{"command": command, **extent} for command in COMMANDS]
    calls = [{**call, "against": name} for call in commands for name in ("", *AGAINST)]
    names = [f"{call['command']} {call['against']}" for call in calls]
    driven = session.compute(drive_command, calls, names)
    if session.failures:
        return False
    runs, *others = (driven[place :: 1 + len(AGAINST)] for place in range(1 + len(AGAINST)))
    session.render(
        rows=rows(runs, list(zip(*others, strict=True))),
        columns=_COLUMNS,
        cut=cut_short(runs[0], others[0][0]),
        cut_columns=_CUT_COLUMNS,
    )
    return True
