"""The suite as a library: a trip, driven in memory or over ROS 2, and its run as tables and pictures."""

from __future__ import annotations

from collections import ChainMap
from importlib import import_module
from typing import TYPE_CHECKING, Any

from iptm_core.extras import offered

if TYPE_CHECKING:
    from iptm.call_cache import Outcome as Outcome
    from iptm.call_cache import cached_calls as cached_calls
    from iptm.climate import Climate as Climate
    from iptm.comparison import Comparison as Comparison
    from iptm.comparison import compare as compare
    from iptm.driving import simulate as simulate
    from iptm.explanation import Explanation as Explanation
    from iptm.faults.fault import Fault as Fault
    from iptm.own_parts import Controller as Controller
    from iptm.own_parts import Predictor as Predictor
    from iptm.own_settings import Vehicle as Vehicle
    from iptm.own_settings import cell_names as cell_names
    from iptm.run import Run as Run
    from iptm.run_file import load as load
    from iptm.sweeping import Sweep as Sweep
    from iptm.sweeping import sweep as sweep
    from iptm.trip import Trip as Trip
    from iptm.trip_drive import drive as drive
    from iptm.trip_files import load_trip as load_trip
    from iptm.trip_files import trip_text as trip_text
    from iptm_controller.measurements import Measurements as Measurements
    from iptm_controller.strategy import STRATEGIES as STRATEGIES
    from iptm_controller.strategy import Strategy as Strategy
    from iptm_core.aging_laws.law import AgingLaw as AgingLaw
    from iptm_core.errors import IptmError as IptmError
    from iptm_core.parameters import ModelParameters as ModelParameters
    from iptm_core.parameters import available_parameter_sets as available_parameter_sets
    from iptm_core.parameters import load_parameters as load_parameters
    from iptm_core.routes import ROUTE_CYCLES as ROUTE_CYCLES
    from iptm_core.state import Command as Command
    from iptm_core.state import LeaderState as LeaderState

# Loaded when first used: a node that imports one module of this package needs neither pandas nor Matplotlib.
_HOMES = {
    "load": "iptm.run_file",
    "Outcome": "iptm.call_cache",
    "cached_calls": "iptm.call_cache",
    "Comparison": "iptm.comparison",
    "compare": "iptm.comparison",
    "drive": "iptm.trip_drive",
    "Explanation": "iptm.explanation",
    "Fault": "iptm.faults.fault",
    "Controller": "iptm.own_parts",
    "Predictor": "iptm.own_parts",
    "Run": "iptm.run",
    "Climate": "iptm.climate",
    "simulate": "iptm.driving",
    "Sweep": "iptm.sweeping",
    "sweep": "iptm.sweeping",
    "Trip": "iptm.trip",
    "load_trip": "iptm.trip_files",
    "trip_text": "iptm.trip_files",
    "Vehicle": "iptm.own_settings",
    "cell_names": "iptm.own_settings",
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

__version__ = "0.3.0"

__all__ = list(_HOMES)


def _homes() -> dict[str, str]:
    """Return the module of every name, of extras too."""
    added = (extra.NAMES for extra in offered("library"))
    return dict(ChainMap(_HOMES, *added))


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name) or _homes().get(name)
    if home is None:
        raise AttributeError(f"module 'iptm' has no attribute {name!r}")
    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    return sorted(_homes())
