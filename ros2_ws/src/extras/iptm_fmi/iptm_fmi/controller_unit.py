"""The controller as a unit: vehicle, leader with its preview and road in, commands and plan out."""

from __future__ import annotations

from iptm_controller.controller import MpcController
from iptm_controller.ocp.data import UNBOUNDED_W
from iptm_controller.options import ControllerOptions
from iptm_core.parameters.model import ModelParameters
from iptm_ecu.controller_code import controller_code
from iptm_fmi.unit import C_SOURCES, Kind, Unit, Variable, literal, road_variables

PREVIEW_ROOM = 64
LONGEST_STEP_S = 10.0


def controller_unit(parameters: ModelParameters, options: ControllerOptions) -> Unit:
    """Return the unit of a controller.

    Raises:
        IptmError: its horizon or its strategy cannot be written as C.
    """
    controller = MpcController(parameters, options)
    nodes = controller.grid.steps + 1
    sources = {
        **controller_code(controller),
        **C_SOURCES.read("controller_unit.c", "controller_memory.h", "descent.h", "road.h"),
    }
    numbers = {
        "TICK_S": options.tick_s,
        "BRAKE_DELAY_S": parameters.brakes.delay_s,
        "BRAKE_BUILD_UP_M_S3": parameters.brakes.build_up_m_s3,
    }
    sizes = f"#define IPTM_PLAN_NODES {nodes}\n"
    sizes += "".join(f"#define IPTM_{name} {literal(value)}\n" for name, value in numbers.items())
    sources["unit_memory.h"] = sizes + sources.pop("controller_memory.h")
    variables = [*_vehicle(parameters), *_ahead(), *road_variables(), *_decision(nodes)]
    places = {"CELL_1_LOSS": "cell_1_capacity_loss", "CELL_N_LOSS": "cell_n_capacity_loss"}
    text = f"Predictive controller, {options.horizon}, strategy {options.strategy.name}"
    return Unit("iptm_controller", text, variables, sources, LONGEST_STEP_S, places)


def _vehicle(parameters: ModelParameters) -> list[Variable]:
    kelvin = parameters.environment.initial_cell_temperature_k
    loss = parameters.aging.initial_capacity_loss
    given = (
        ("position", "m", "of the front bumper along the road", 0.0, -1e7, 1e7),
        ("speed", "m/s", "of the vehicle", 0.0, 0.0, 200.0),
        ("acceleration", "m/s2", "over the last tick", 0.0, -20.0, 20.0),
        ("compressor_power", "W", "over the last tick", 0.0, -1e5, 1e5),
        ("cell_1_temperature", "K", "of the first cell of a channel", kelvin, 200.0, 400.0),
        ("cell_n_temperature", "K", "of the last cell of a channel", kelvin, 200.0, 400.0),
        ("cell_1_capacity_loss", "1", "of the first cell", loss, 1e-9, 0.9),
        ("cell_n_capacity_loss", "1", "of the last cell", loss, 1e-9, 0.9),
        ("charge_limit", "W", "largest charging power of the pack", UNBOUNDED_W, 0.0, UNBOUNDED_W),
    )
    return [
        Variable(name, Kind.INPUT, unit, text, start, least, most)
        for name, unit, text, start, least, most in given
    ]


def _ahead() -> list[Variable]:
    return [
        Variable(
            "foreseen_aging_rate",
            Kind.PARAMETER,
            "1/s",
            "of both cells, expected for the trip at its start; 0: temperatures have no price at the end",
            0.0,
            0.0,
            1.0,
        ),
        Variable(
            "leader_position", Kind.INPUT, "m", "of the rear bumper of the lead vehicle", 50.0
        ),
        Variable("leader_speed", Kind.INPUT, "m/s", "of the lead vehicle", 0.0, 0.0, 200.0),
        Variable(
            "preview_nodes",
            Kind.INPUT,
            "1",
            "nodes of the preview that count; 0: the leader is extrapolated",
            0.0,
            0.0,
            PREVIEW_ROOM,
        ),
        Variable(
            "preview_time", Kind.INPUT, "s", "increasing times of the nodes", size=PREVIEW_ROOM
        ),
        Variable(
            "preview_position", Kind.INPUT, "m", "of the lead vehicle then", size=PREVIEW_ROOM
        ),
        Variable(
            "preview_speed",
            Kind.INPUT,
            "m/s",
            "of the lead vehicle then",
            0.0,
            0.0,
            200.0,
            PREVIEW_ROOM,
        ),
    ]


def _decision(nodes: int) -> list[Variable]:
    given = (
        ("acceleration_command", "m/s2", "for the next tick", None),
        ("compressor_power_command", "W", "for the next tick, negative for the heater", None),
        ("rung", "1", "0 optimal, 1 last plan moved on, 2 safe law, 3 stop", None),
        ("limits", "1", "bits of the limits that changed the command, see limiter.h", None),
        ("iterations", "1", "of the solver", None),
        ("held", "1", "1: no tick in this step, the command is held", None),
        ("missed_ticks", "1", "ticks inside longer steps, which were not decided", None),
        ("plan_position", "m", "at the nodes of the horizon", nodes),
        ("plan_speed", "m/s", "at the nodes of the horizon", nodes),
        ("plan_cell_1_temperature", "K", "at the nodes of the horizon", nodes),
    )
    return [Variable(name, Kind.OUTPUT, unit, text, size=size) for name, unit, text, size in given]
