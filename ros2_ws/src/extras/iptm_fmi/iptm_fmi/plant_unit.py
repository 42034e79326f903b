"""The vehicle with its pack as a unit, and the meter: the same vehicle along a measured speed."""

from __future__ import annotations

import math

import casadi as ca

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.model_numbers import SymbolicModel
from iptm_core.physics.pack_limits import least_traction_power_w, terminal_limits_w
from iptm_core.physics.power_thermal import CellPair
from iptm_core.settings import IntegrationSettings
from iptm_fmi.unit import C_SOURCES, Kind, Unit, Variable, literal, road_variables
from iptm_plant_sim.c_sources import C_SOURCES as PLANT_SOURCES
from iptm_plant_sim.interval import AT_END, INTEGRALS, sub_step
from iptm_plant_sim.interval import STATES as CELLS

LONGEST_STEP_S = 10.0
_UNITS = {"a": "A", "k": "K", "v": "V", "j": "J", "c": "C"}
_BEFORE_GENERATED = """\
/* Functions of CasADi have one form, whatever they need of it; they are called in this library only. */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#define CASADI_SYMBOL_EXPORT
"""
_TEXTS = {
    "traction_energy": "of the motor since the start, recovered energy taken off",
    "regenerated_energy": "its negative part, before the regenerative efficiency",
    "battery_energy": "from the terminals of the pack since the start",
    "chiller_heat": "taken from the coolant since the start",
    "battery_heat": "made in all cells since the start",
    "charge": "drawn from the pack since the start",
}


def plant_unit(parameters: ModelParameters) -> Unit:
    """Return the unit of a vehicle with commands as inputs."""
    limits = parameters.limits
    commands = [
        Variable(
            "acceleration_command",
            Kind.INPUT,
            "m/s2",
            "limited by bounds and jerk before it acts",
        ),
        Variable(
            "compressor_power_command",
            Kind.INPUT,
            "W",
            "of the compressor, negative for the heater; limited by bounds and rate before it acts",
            limits.min_compressor_power_w,
        ),
    ]
    return _vehicle(
        "iptm_plant", "Electric vehicle with its battery and cooling", parameters, commands
    )


def meter_unit(parameters: ModelParameters) -> Unit:
    """Return the unit of a vehicle that follows a measured speed, its pack cooled by a thermostat."""
    speed = Variable(
        "speed_measured",
        Kind.INPUT,
        "m/s",
        "at the end of the step; the acceleration in it is constant",
        0.0,
        0.0,
        parameters.limits.max_speed_m_s,
    )
    text = "Energy, temperatures and ageing of an electric vehicle by its speed"
    return _vehicle("iptm_meter", text, parameters, [speed], "#define IPTM_METER\n")


def _vehicle(
    name: str, text: str, parameters: ModelParameters, inputs: list[Variable], define: str = ""
) -> Unit:
    define += "#define IPTM_LIMITED\n" if parameters.pack_limits.limited else ""
    numbers = define + "".join(
        f"#define IPTM_{key} {literal(value)}\n" for key, value in _numbers(parameters).items()
    )
    most = math.ceil(LONGEST_STEP_S / IntegrationSettings.integration_step_s) + 2
    numbers += f"#define IPTM_AT_END {len(AT_END)}\n#define IPTM_SUB_STEPS_MOST {most}\n"
    sources = {
        **PLANT_SOURCES.read("interval.c"),
        **C_SOURCES.read("plant.c", "plant_memory.h", "road.h"),
        "model.c": model_code(parameters),
        "plant_numbers.h": numbers,
    }
    sources["unit_memory.h"] = sources.pop("plant_memory.h")
    variables = [
        *inputs,
        Variable(
            "slope",
            Kind.INPUT,
            "rad",
            "of the road in the whole step, positive uphill; added to the slope of the road's nodes",
            0.0,
            -0.5,
            0.5,
        ),
        *road_variables(),
        *_states(parameters),
        *(_sum(each) for each in (*INTEGRALS, "compressor_energy_j")),
        *(_at_end(each) for each in AT_END),
    ]
    places = {
        "ENERGIES": _without_unit(INTEGRALS[0]),
        "AT_END": _without_unit(AT_END[0]),
        "CELL_1_LOSS": "cell_1_capacity_loss",
        "CELL_N_LOSS": "cell_n_capacity_loss",
    }
    return Unit(name, text, variables, sources, LONGEST_STEP_S, places)


def model_code(parameters: ModelParameters) -> str:
    """Return the generated C of a sub-step of the pack, and of what is known at the end of a step."""
    generator = ca.CodeGenerator("model.c", {"with_header": False})
    limited = parameters.pack_limits.limited
    for function in sub_step(SymbolicModel.literal(parameters), bounded=limited):
        generator.add(function)
    if limited:
        generator.add(_pack_bounds(parameters))
    return f"{_BEFORE_GENERATED}{generator.dump()}"


def _pack_bounds(parameters: ModelParameters) -> ca.Function:
    """Return the function from cells, charge, thermal power and length of a step to `PowerBounds`."""
    cells, charge = ca.SX.sym("cells", len(CELLS)), ca.SX.sym("charge")
    power_w, length_s = ca.SX.sym("power_w"), ca.SX.sym("length_s")
    pair = CellPair(*ca.vertsplit(cells))
    charge_w, discharge_w = terminal_limits_w(pair, charge, parameters, length_s)
    least_w = least_traction_power_w(charge_w, power_w, parameters)
    bounds = ca.vertcat(least_w, discharge_w)
    return ca.Function("pack_bounds", [cells, charge, power_w, length_s], [bounds])


def _numbers(parameters: ModelParameters) -> dict[str, float]:
    limits = parameters.limits
    return {
        "SUB_STEP_S": IntegrationSettings.integration_step_s,
        "MIN_ACCELERATION_M_S2": limits.min_acceleration_m_s2,
        "MAX_ACCELERATION_M_S2": limits.max_acceleration_m_s2,
        "MAX_JERK_M_S3": limits.max_jerk_m_s3,
        "MIN_POWER_W": limits.lowest_thermal_power_w,
        "MAX_POWER_W": limits.max_compressor_power_w,
        "MAX_POWER_RATE_W_S": limits.max_compressor_rate_w_s,
        "MAX_SPEED_M_S": limits.max_speed_m_s,
        "REGENERATIVE_M_S2": min(parameters.brakes.regenerative_deceleration_m_s2, 1e9),
        "CAPACITY_AH": parameters.cell.nominal_capacity_ah * parameters.pack.parallel,
    }


def _states(parameters: ModelParameters) -> list[Variable]:
    limits, kelvin = parameters.limits, parameters.environment.initial_cell_temperature_k
    loss = parameters.aging.initial_capacity_loss
    given = (
        ("position", "m", "along the road", 0.0, -1e7, 1e7),
        ("speed", "m/s", "never negative", 0.0, 0.0, limits.max_speed_m_s),
        ("acceleration", "m/s2", "over the last step", 0.0, -20.0, 20.0),
        (
            "compressor_power",
            "W",
            "over the last step, negative of the heater",
            limits.min_compressor_power_w,
            limits.lowest_thermal_power_w,
            limits.max_compressor_power_w,
        ),
        ("cell_1_temperature", "K", "of the first cell of a coolant channel", kelvin, 200.0, 400.0),
        ("cell_n_temperature", "K", "of the last cell of a coolant channel", kelvin, 200.0, 400.0),
        ("cell_1_capacity_loss", "1", "of the first cell, of its capacity", loss, 1e-9, 0.9),
        ("cell_n_capacity_loss", "1", "of the last cell, of its capacity", loss, 1e-9, 0.9),
        (
            "state_of_charge",
            "1",
            "of the present capacity of the pack",
            parameters.charge.initial_charge,
            0.0,
            1.0,
        ),
    )
    return [
        Variable(name, Kind.START, unit, text, start, least, most)
        for name, unit, text, start, least, most in given
    ]


def _without_unit(name: str) -> str:
    return name.rpartition("_")[0]


def _sum(name: str) -> Variable:
    of, unit = _without_unit(name), _UNITS[name.rpartition("_")[2]]
    return Variable(of, Kind.OUTPUT, unit, _TEXTS.get(of, "of the compressor since the start"))


def _at_end(name: str) -> Variable:
    of, unit = _without_unit(name), _UNITS[name.rpartition("_")[2]]
    return Variable(of, Kind.OUTPUT, unit, "at the end of the step")
