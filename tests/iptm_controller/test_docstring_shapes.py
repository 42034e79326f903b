"""Shapes in docstrings are those of the objects: "shape (N + 1, STATES)" in an entry of a section."""

from __future__ import annotations

import inspect
import re
from typing import Any

import casadi as ca
import numpy as np
import pytest
from tests.iptm_controller.scenes import (
    PARAMETERS,
    SCENES,
    make_state,
    problem_of,
    transcription_of,
)

from iptm_controller.forecast import LeaderForecaster
from iptm_controller.horizon import Horizon
from iptm_controller.ocp import layout
from iptm_controller.ocp.grid import ProblemGrid
from iptm_controller.ocp.problem import OptimalControlProblem
from iptm_controller.plan import PlanShifter
from iptm_core.routes import build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.route import RoadCourse, RoadPoses
from iptm_core.state import SlopePreview
from iptm_plant_sim.actuators import plan_motion

HORIZON = "3x1+5x5"
ENTRY = re.compile(r"^    (\w+): ((?:.|\n(?!    \w+: |\S|\n))*)", re.MULTILINE)
SHAPE = re.compile(r"shapes? \(([^()]*(?:\([^()]*\))?[^()]*)\)")


def stated_shapes(documented: object) -> dict[str, list[str]]:
    """Return the stated dimensions by name of the entry."""
    entries = ENTRY.findall(inspect.getdoc(documented) or "")
    shapes = {name: SHAPE.search(text) for name, text in entries}
    return {
        name: [size.strip() for size in found[1].split(",") if size.strip()]
        for name, found in shapes.items()
        if found
    }


def shape_of(value: Any) -> tuple[int, ...]:
    if isinstance(value, ca.Function):
        value = value.sparsity_out(0)
    shape = tuple(value.shape)
    symbolic = isinstance(value, ca.SX | ca.MX | ca.Sparsity)
    return shape[:1] if symbolic and shape[1] == 1 else shape


def check(documented: object, values: dict[str, Any], **sizes: int) -> None:
    """Compare all stated shapes; a size without a value takes the one of its first occurrence."""
    known = {**{name: size for name, size in vars(layout).items() if name.isupper()}, **sizes}
    stated = stated_shapes(documented)
    assert stated, f"{documented} states no shape"
    for name, dimensions in stated.items():
        # An optional attribute: None, or an empty array.
        if values[name] is None or getattr(values[name], "size", 1) == 0:
            continue
        actual = shape_of(values[name])
        assert len(dimensions) == len(actual), f"{name}: ({', '.join(dimensions)}) is {actual}"
        for dimension, size in zip(dimensions, actual, strict=True):
            if dimension.isidentifier():
                known.setdefault(dimension, size)
            product = re.sub(r"(\d) (\w)", r"\1 * \2", dimension)
            assert eval(product, {}, known) == size, f"{name}: {dimension} is {size}"  # noqa: S307


def check_object(made: object, **sizes: int) -> None:
    check(type(made), {name: getattr(made, name) for name in stated_shapes(type(made))}, **sizes)


def test_shapes_of_the_problem() -> None:
    problem = OptimalControlProblem(Horizon.parse(HORIZON), PARAMETERS)
    steps = problem.grid.steps
    for stage in problem.stage_expressions():
        check_object(stage)
    transcription = transcription_of(HORIZON)
    check_object(transcription, N=steps)
    for functions in transcription.stages:
        check_object(functions)
    data, guess = problem_of(SCENES[min(SCENES)], HORIZON)
    check_object(data)
    grid = ProblemGrid(Horizon.parse(HORIZON))
    states, inputs = grid.split(guess)
    assert (states.shape, inputs.shape) == ((steps + 1, layout.STATES), (steps, layout.INPUTS))
    rows = {
        "shared": np.zeros(layout.GLOBALS),
        "steps": np.zeros((steps, layout.STEP_PARAMETERS)),
        "samples": np.zeros((grid.sample_times_s.size, layout.SAMPLE_PARAMETERS)),
    }
    assert grid.parameters(**rows).shape == (grid.parameter_count,)
    check(ProblemGrid.parameters, rows, N=steps, samples=grid.sample_times_s.size)


def test_shapes_of_plan_and_forecast() -> None:
    horizon = Horizon.parse(HORIZON)
    check_object(PlanShifter(horizon).cold_start(make_state()), N=len(horizon.step_lengths_s))
    scene = SCENES[min(SCENES)]
    motion = LeaderForecaster(horizon.duration_s, 10.0).forecast(scene.leader, scene.preview).motion
    check_object(motion)


@pytest.mark.parametrize("speed_m_s", [0.4, 20.0])
def test_shapes_of_a_motion(speed_m_s: float) -> None:
    check_object(plan_motion(0.0, speed_m_s, -1.0, 40.0, 1.0, 10))


def test_shapes_of_routes() -> None:
    route = build_route("us06", "large", initial_gap_m=30.0, duration_s=60.0)
    line = RoadLine.test_road()
    for made in (route.leader, route.slope, line):
        check_object(made)
    course = RoadCourse(SlopePreview(np.arange(2.0), np.zeros(2)), line)
    check(RoadPoses, vars(course.poses(np.arange(4.0), 5.0)))
