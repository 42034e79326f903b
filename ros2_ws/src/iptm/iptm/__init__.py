"""The suite as a library: a trip, driven in memory or over ROS 2, and its run as tables and pictures."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from iptm.bags import load
    from iptm.call_cache import Outcome, cached_calls
    from iptm.climate import Climate
    from iptm.comparison import Comparison, compare
    from iptm.driving import drive_whole_trip, simulate
    from iptm.explanation import Explanation
    from iptm.faults.fault import Fault
    from iptm.own_parts import Controller, Predictor
    from iptm.run import Run
    from iptm.service_life.life import Life, life
    from iptm.service_life.year import Usage
    from iptm.sweeping import Sweep, sweep
    from iptm.trip import Trip
    from iptm.trip_drive import drive
    from iptm.trip_files import load_trip, trip_text
    from iptm.vehicle import Vehicle, cell_names
    from iptm_controller.measurements import Measurements
    from iptm_controller.strategy import STRATEGIES, Strategy
    from iptm_core.aging_laws.law import AgingLaw
    from iptm_core.errors import IptmError
    from iptm_core.parameters import ModelParameters, available_parameter_sets, load_parameters
    from iptm_core.routes import ROUTE_CYCLES
    from iptm_core.state import Command, LeaderState

# Loaded when first used: a node that imports one module of this package needs neither pandas nor Matplotlib.
_HOMES = {
    "load": "iptm.bags",
    "Outcome": "iptm.call_cache",
    "cached_calls": "iptm.call_cache",
    "Comparison": "iptm.comparison",
    "compare": "iptm.comparison",
    "drive": "iptm.trip_drive",
    "drive_whole_trip": "iptm.driving",
    "Explanation": "iptm.explanation",
    "Fault": "iptm.faults.fault",
    "Controller": "iptm.own_parts",
    "Predictor": "iptm.own_parts",
    "Run": "iptm.run",
    "Life": "iptm.service_life.life",
    "life": "iptm.service_life.life",
    "Climate": "iptm.climate",
    "Usage": "iptm.service_life.year",
    "simulate": "iptm.driving",
    "Sweep": "iptm.sweeping",
    "sweep": "iptm.sweeping",
    "Trip": "iptm.trip",
    "load_trip": "iptm.trip_files",
    "trip_text": "iptm.trip_files",
    "Vehicle": "iptm.vehicle",
    "cell_names": "iptm.vehicle",
    "Measurements": "iptm_controller.measurements",
    "STRATEGIES": "iptm_controller.strategy",
    "Strategy": "iptm_controller.strategy",
    "AgingLaw": "iptm_core.aging_laws.law",
    "IptmError": "iptm_core.errors",
    "ModelParameters": "iptm_core.parameters",
    "available_parameter_sets": "iptm_core.parameters",
    "load_parameters": "iptm_core.parameters",
    "ROUTE_CYCLES": "iptm_core.routes",
    "Command": "iptm_core.state",
    "LeaderState": "iptm_core.state",
}

__version__ = "0.2.0"

__all__ = [
    "ROUTE_CYCLES",
    "STRATEGIES",
    "AgingLaw",
    "Climate",
    "Command",
    "Comparison",
    "Controller",
    "Explanation",
    "Fault",
    "IptmError",
    "LeaderState",
    "Life",
    "Measurements",
    "ModelParameters",
    "Outcome",
    "Predictor",
    "Run",
    "Strategy",
    "Sweep",
    "Trip",
    "Usage",
    "Vehicle",
    "__version__",
    "available_parameter_sets",
    "cached_calls",
    "cell_names",
    "compare",
    "drive",
    "drive_whole_trip",
    "life",
    "load",
    "load_parameters",
    "load_trip",
    "simulate",
    "sweep",
    "trip_text",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'iptm' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
