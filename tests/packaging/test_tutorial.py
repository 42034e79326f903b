"""Figures in the prose of the tutorial and of the page on comparisons come from its commands."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import replace

import pytest
from tests.packaging.packages import ROOT

import iptm
from iptm.commands.run import build_parser, chosen_trip, parsed_options
from iptm_core.trajectory import Trajectory

_FIGURE = re.compile(r"(?<![\w.])\d+\.\d+(?= and | %| ppm)")
PAGES = ("docs/tutorial.md", "docs/explanation/comparison.md")
CUT_S = (120.0, 300.0)
BLOCKS = re.findall(
    r"^```bash\n(.*?)^```", (ROOT / PAGES[0]).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
)
COMMANDS = [
    line
    for line in "".join(BLOCKS).replace("\\\n", "").splitlines()
    if line.startswith("scripts/run_demo") and not re.search(r"run_demo demo|--(view|list)", line)
]
REPEATED = "scripts/run_demo --cycle us06 --slope large --duration-s 1200"
"""The command whose page states the saving of the trip driven again and again, which takes the longest."""


def shares(own: iptm.Run, other: iptm.Run) -> Iterator[str]:
    saving = own.saving(other)
    for found in (saving.energy, saving.aging):
        yield f"{found.as_driven_percent:.1f}"
        yield f"{found.equal_ends_percent:.1f}"
        yield f"{found.stated_percent:.1f}"
    yield f"{abs(saving.cells.median):.1f}"


def until(run: iptm.Run, last_s: float) -> iptm.Run:
    columns = run.trajectory.to_arrays()
    kept = columns["time_s"] <= last_s
    cut = {name: values[kept] for name, values in columns.items()}
    return replace(run, trajectory=Trajectory.from_arrays(cut))


def figures_of(command: str, references: dict[str, iptm.Run]) -> Iterator[str]:
    """Drive a command without ROS and yield its figures as the pages would write them."""
    trip = chosen_trip(parsed_options(build_parser(), shlex.split(command)[1:]))
    own, against = iptm.drive(trip), trip.against("reference")
    text = iptm.trip_text(against)
    if text not in references:
        references[text] = iptm.drive(against)
    other = references[text]
    yield from shares(own, other)
    yield from (f"{run.figures['total_degradation']:.2f}" for run in (own, other))
    if command == "scripts/run_demo":
        for last_s in CUT_S:
            yield from shares(until(own, last_s), until(other, last_s))


@pytest.fixture(scope="module")
def driven() -> set[str]:
    """Every figure of the commands."""
    found: set[str] = set()
    references: dict[str, iptm.Run] = {}
    for command in COMMANDS:
        with pytest.MonkeyPatch.context() as patch:
            if command != REPEATED:
                patch.setattr("iptm.run._repeated", lambda own, other: None)  # noqa: ARG005
            found |= {*figures_of(command, references)}
    return found


@pytest.mark.parametrize("page", PAGES)
def test_every_figure_with_a_point_is_one_of_its_commands(page: str, driven: set[str]) -> None:
    text = (ROOT / page).read_text(encoding="utf-8").split("The summary names")[0]
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    figures = set(_FIGURE.findall(" ".join(prose.split())))
    assert len(figures) > 3
    assert figures <= driven


def test_six_commands_are_driven() -> None:
    assert len(COMMANDS) == 6
    assert REPEATED in COMMANDS
