"""A scenario: what one closed-loop run is made of, as data.

Every field of `Scenario` that has a unit and a range is also an option of the command line and a key of
scenario files; `scenario_specs` lists them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

from iptm_controller.horizon import MULTI_HORIZON
from iptm_controller.solvers.factory import SOLVER_NAMES
from iptm_controller.strategy import STRATEGIES
from iptm_core.parameters import DEFAULT_SET
from iptm_core.routes import SLOPE_CHOICES
from iptm_interfaces.parameters import ParameterSpec, parameter
from iptm_v2x_bridge.bridge import PreviewMode
from iptm_v2x_bridge.imperfections import MAX_BURST, MAX_SEED
from iptm_v2x_bridge.source import MAX_LENGTH_S, MIN_LENGTH_S, MIN_STEP_S

Scalar = bool | int | float | str

LOCK_STEP = "lock_step"
REAL_TIME = "real_time"
AUTOMATIC_DOMAIN = -1
MAX_DOMAIN = 232

NODES = ("plant", "v2x_bridge", "controller")
"""Names of the nodes of the loop; extra parameters in a scenario are grouped by them."""

_NO_PARAMETERS: Mapping[str, Mapping[str, Scalar]] = MappingProxyType({})


@dataclass(frozen=True)
class Scenario:
    """What is driven, by whom, under which conditions; ranges and units are in the declarations.

    Attributes:
        name: short name, also that of the run's folder.
        description: one line for lists.
        node_parameters: further parameters by node (one of `NODES`) and name; the nodes check them.
    """

    name: str = "custom"
    description: str = ""
    cycle: str = parameter(
        "wltc_class3b", "driving cycle of the leader: a name, or the path of a .csv file"
    )
    slope: str = parameter("as_designed", "slope of the road", choices=SLOPE_CHOICES)
    duration_s: float = parameter(0.0, "length of the trip, 0 for the whole cycle", "s", 0.0, 1e6)
    parameter_set: str = parameter(
        DEFAULT_SET, "parameters of the vehicle: name of a shipped set, or the path of a .yaml file"
    )
    parameter_overrides: str = parameter(
        "", "single model parameters to change, e.g. 'body.mass_kg=1600, gap.max_gap_m=80'"
    )
    strategy: str = parameter(
        "aging", "cost of the controller, one of the paper's strategies", choices=tuple(STRATEGIES)
    )
    horizon: str = parameter(
        str(MULTI_HORIZON), "prediction grid, <steps>x<seconds> parts joined by +"
    )
    solver: str = parameter("riccati", "solver back end", choices=SOLVER_NAMES)
    preview_mode: str = parameter(
        PreviewMode.FULL.value,
        "what the host is told about the future of the leader",
        choices=tuple(mode.value for mode in PreviewMode),
    )
    preview_length_s: float = parameter(
        60.0, "how far a prediction of the leader reaches", "s", MIN_LENGTH_S, MAX_LENGTH_S
    )
    preview_step_s: float = parameter(
        1.0, "time between the nodes of a prediction", "s", MIN_STEP_S, MAX_LENGTH_S
    )
    latency_s: float = parameter(
        0.0, "delay from generation to reception of a prediction", "s", 0.0, 3600.0
    )
    dropout_probability: float = parameter(0.0, "share of the predictions lost", "", 0.0, 1.0)
    dropout_burst: int = parameter(
        1, "predictions lost in a row by one disturbance", "", 1, MAX_BURST
    )
    noise_std_m_s: float = parameter(
        0.0, "standard deviation of the predicted speed, far ahead", "m/s", 0.0, 20.0
    )
    noise_correlation_s: float = parameter(
        10.0, "correlation time of the speed error along a prediction", "s", 0.1, 3600.0
    )
    seed: int = parameter(0, "seed of loss and error of the predictions", "", 0, MAX_SEED)
    mode: str = parameter(
        LOCK_STEP,
        "lock_step runs as fast as the machine can, real_time follows the wall clock",
        choices=(LOCK_STEP, REAL_TIME),
    )
    rate_factor: float = parameter(
        1.0, "real_time: seconds of trip time per second of wall time", "", 0.01, 1000.0
    )
    namespace: str = parameter("", "namespace of all nodes, e.g. car_1; empty for none")
    domain: int = parameter(
        AUTOMATIC_DOMAIN,
        "ROS domain of the run; -1 takes ROS_DOMAIN_ID, or a free one where that is not set",
        "",
        AUTOMATIC_DOMAIN,
        MAX_DOMAIN,
    )
    node_parameters: Mapping[str, Mapping[str, Scalar]] = field(
        default_factory=lambda: _NO_PARAMETERS
    )

    @property
    def full_namespace(self) -> str:
        """Namespace as ROS writes it, with a leading slash; ``/`` for none."""
        return "/" + self.namespace.strip("/")


def scenario_specs() -> tuple[ParameterSpec, ...]:
    """Return the fields that files and options set, with unit, range and default."""
    specs = []
    for entry in fields(Scenario):
        default: Any = entry.default
        if entry.metadata:
            specs.append(ParameterSpec(entry.name, default, **entry.metadata))
    return tuple(specs)
