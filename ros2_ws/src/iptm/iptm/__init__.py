"""The suite as a library: simulate, load, compare and sweep; results as pandas tables and pictures."""

from iptm.bags import load
from iptm.comparison import Comparison, compare
from iptm.own_parts import Controller, Predictor
from iptm.run import Run
from iptm.simulation import Sweep, simulate, sweep
from iptm_controller.measurements import Measurements
from iptm_controller.strategy import STRATEGIES, Strategy
from iptm_core.aging_laws.law import AgingLaw
from iptm_core.errors import IptmError
from iptm_core.parameters import ModelParameters, available_parameter_sets, load_parameters
from iptm_core.routes import ROUTE_CYCLES
from iptm_core.state import Command, LeaderState

__all__ = [
    "ROUTE_CYCLES",
    "STRATEGIES",
    "AgingLaw",
    "Command",
    "Comparison",
    "Controller",
    "IptmError",
    "LeaderState",
    "Measurements",
    "ModelParameters",
    "Predictor",
    "Run",
    "Strategy",
    "Sweep",
    "available_parameter_sets",
    "compare",
    "load",
    "load_parameters",
    "simulate",
    "sweep",
]
