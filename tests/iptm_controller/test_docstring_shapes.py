"""Shapes in docstrings, "shape (N + 1, STATES)", are those of the objects."""

from __future__ import annotations

import inspect
import re

import pytest
from tests.iptm_controller.scenes import PARAMETERS, SCENES, problem_of, transcription_of

from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_core.routes import build_route

ENTRY = re.compile(r"^    (\w+): ((?:.|\n(?!    \w+: |\S|\n))*)", re.MULTILINE)
SHAPE = re.compile(r"shapes? \(([^()]*)\)")
PROBLEM = OptimalControlProblem(Horizon.parse("3x1+5x5"), PARAMETERS)
ROUTE = build_route("us06", "large", initial_gap_m=15.0)
OBJECTS = (
    *PROBLEM.stage_expressions(), transcription_of("3x1+5x5"), problem_of(SCENES["hills"], "3x1+5x5")[0],
    SCENES["hills"].preview, ROUTE.slope, ROUTE.road_line,
)  # fmt: skip


@pytest.mark.parametrize("made", OBJECTS, ids=lambda made: type(made).__name__)
def test_stated_shapes_are_those_of_the_object(made: object) -> None:
    known = {"N": PROBLEM.grid.steps, **vars(layout)}
    entries = ENTRY.findall(inspect.getdoc(type(made)) or "")
    stated = {name: found[1] for name, text in entries if (found := SHAPE.search(text))}
    assert stated
    for name, text in stated.items():
        # What is optional is None or empty.
        if getattr(made, name) is None or not (actual := getattr(made, name).shape)[0]:
            continue
        sizes = [size for part in text.split(",") if (size := part.strip())]
        assert len(sizes) == len(actual[: 1 if actual[1:] == (1,) else None]), name
        for size, number in zip(sizes, actual, strict=False):
            known.setdefault(size, number)
            product = re.sub(r"(\d) (\w)", r"\1 * \2", size)
            assert eval(product, known) == number, f"{name}: {size} is {number}"  # noqa: S307
