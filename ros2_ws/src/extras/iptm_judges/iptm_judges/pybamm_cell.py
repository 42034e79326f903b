"""Mechanisms of PyBaMM's single-particle model as judges: SEI, plating and mechanics.

A cell of 5 Ah (LG M50, parameters of O'Kane et al. 2022, doi:10.1039/D2CP00417H) under current and
temperature of a trip, from its state of charge. The levels of the shipped parameters are not fitted to any
pack, and those for plating and mechanics are not credible: only ratios of two runs mean something.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from importlib.metadata import version
from typing import Any

import numpy as np

from iptm_core.aging_laws.judging import Exposure, Judge
from iptm_core.errors import StateError
from iptm_core.units import SECONDS_PER_HOUR

os.environ.setdefault("PYBAMM_DISABLE_TELEMETRY", "true")
pybamm: Any = import_module("pybamm")  # of requirements/judges.txt

GROUP, CHARGED_GROUP = "PyBaMM, the trip alone", "PyBaMM, trips with charging"
DISTRIBUTION = "pybamm"
PARAMETERS = "OKane2022"
CHARGED_TRIPS = 4
SAMPLE_S = 10.0
TOLERANCES = {"rtol": 1e-7, "atol": 1e-10}
_NEW_CRACK_FILM_M = 5e-9


@dataclass(frozen=True)
class PybammMechanism:
    """A way to lose capacity.

    Attributes:
        model: options of the model by which it is solved, see `MODELS`.
        variable: of the solution, whose change is the loss.
        per: what the change is divided by; None for the capacity in Ah.
    """

    model: str
    variable: str
    per: float | None = None


MODELS: Mapping[str, Mapping[str, Any]] = {
    "solvent": {"SEI": "solvent-diffusion limited"},
    "all": {
        "SEI": "interstitial-diffusion limited",
        "SEI on cracks": "true",
        "lithium plating": "irreversible",
        "particle mechanics": ("swelling and cracking", "swelling only"),
        "loss of active material": "stress-driven",
    },
}
_LOST = "Loss of capacity to negative {} [A.h]"
MECHANISMS = {
    "SEI, solvent diffusion": PybammMechanism("solvent", _LOST.format("SEI")),
    "SEI, interstitial diffusion": PybammMechanism("all", _LOST.format("SEI")),
    "SEI on cracks": PybammMechanism("all", _LOST.format("SEI on cracks")),
    "plating, irreversible": PybammMechanism("all", _LOST.format("lithium plating")),
    "active material by stress": PybammMechanism(
        "all", "Loss of active material in negative electrode [%]", 100.0
    ),
}


def judges(group: str = GROUP, trips: int = 0) -> tuple[Judge, ...]:
    """Return a judge for each mechanism.

    Args:
        trips: of the use, each with its charging; 0 for the trip alone.
    """
    arguments = {"trips": trips, "release": version(DISTRIBUTION)}
    return tuple(Judge(name, group, loss, {"mechanism": name, **arguments}) for name in MECHANISMS)


charged_judges = partial(judges, CHARGED_GROUP, CHARGED_TRIPS)


def loss(mechanism: str, trips: int, release: str, exposure: Exposure) -> float:  # noqa: ARG001
    """Return the capacity lost to a mechanism, as a share of nominal capacity.

    Raises:
        StateError: the model cannot be solved to the end; at which second and voltage.
    """
    asked = MECHANISMS[mechanism]
    solution, capacity_ah = _solved(asked.model, trips, exposure)
    values = solution[asked.variable].entries
    return float(values[-1] - values[0]) / (asked.per or capacity_ah)


@lru_cache(maxsize=8)
def _solved(model: str, trips: int, exposure: Exposure) -> tuple[Any, float]:
    """Return a solution and the capacity of the cell; exposures count by identity."""
    use = exposure.repeated(trips) if trips else exposure
    pybamm.set_logging_level("ERROR")
    values = pybamm.ParameterValues(PARAMETERS)
    capacity_ah = float(values["Nominal cell capacity [A.h]"])
    time_s = use.time_s - use.time_s[0]
    c_rate_1_h = -SECONDS_PER_HOUR * np.diff(use.charge) / np.diff(time_s)
    current_a = capacity_ah * np.append(c_rate_1_h, 0.0)
    values["Current function [A]"] = pybamm.Interpolant(time_s, current_a, pybamm.t)
    kelvin = use.temperature_k
    values["Ambient temperature [K]"] = lambda _y, _z, t: pybamm.Interpolant(time_s, kelvin, t)
    values["Initial temperature [K]"] = float(kelvin[0])
    if "SEI on cracks" in MODELS[model]:
        values["Initial SEI on cracks thickness [m]"] = _NEW_CRACK_FILM_M
    cell = pybamm.lithium_ion.SPMe({"thermal": "isothermal", **MODELS[model]})
    simulation = pybamm.Simulation(
        cell, parameter_values=values, solver=pybamm.IDAKLUSolver(**TOLERANCES)
    )
    instants_s = np.arange(0.0, time_s[-1], SAMPLE_S)
    try:
        solution = simulation.solve(instants_s, initial_soc=float(use.charge[0]))
    except pybamm.SolverError as error:
        raise StateError(f"PyBaMM: {' '.join(str(error).split())}") from error
    ended_s = float(solution.t[-1])
    if ended_s < instants_s[-1] - SAMPLE_S:
        volt = float(solution["Voltage [V]"].entries[-1])
        raise StateError(
            f"PyBaMM: {solution.termination} at {ended_s:.0f} s and {volt:.3f} V; allowed: a trip of "
            f"{instants_s[-1]:.0f} s inside the limits of the cell"
        )
    return solution, capacity_ah
