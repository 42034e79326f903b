"""From the names in a specification to the numbers that a run works on.

The numbers travel to the worker that performs the run, so that a worker needs no files of its own.
"""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from functools import cached_property, lru_cache

import numpy as np

from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.charging_stop import ChargingStopSettings
from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters, to_flat_dict
from iptm_core.parameters.model import ModelParameters
from iptm_core.routes import Route, build_route
from iptm_core.routes.user_csv import UserTrip
from iptm_faults.fault import plain_faults
from iptm_studies.fingerprint import code_fingerprint
from iptm_studies.run_spec import RunSpec, canonical_json

KEY_FORMAT = 1
KEY_LENGTH = 32


@dataclass(frozen=True, eq=False)
class RunInputs:
    """A run with everything it needs.

    Attributes:
        parameters: of the vehicle.
        fingerprint: of the code and libraries that it is meant for.
        address: the first case that asks for it, ``study/case``; a label only.
        controller_parameters: of the controller where its model is not that of the vehicle, None where it is.
    """

    spec: RunSpec
    parameters: ModelParameters
    route: Route
    fingerprint: str
    address: str = ""
    controller_parameters: ModelParameters | None = None

    @cached_property
    def key(self) -> str:
        """Key of the result, see ``run_key``."""
        return run_key(self)

    @property
    def ticks(self) -> int:
        """Number of decisions in the run."""
        return round(self.route.duration_s / self.spec.tick_s)


def resolve_inputs(spec: RunSpec, address: str = "", drive: UserTrip | None = None) -> RunInputs:
    """Look up parameters and route; with a drive, the cycle of the specification is but its name.

    Raises:
        IptmError: a name, a key, a value or a file is not usable.
    """
    parameters = _parameters(spec.parameter_set, spec.overrides)
    gap_m = parameters.gap.initial_gap_m
    route = (
        _route(spec.cycle, spec.slope, gap_m, spec.duration_s)
        if drive is None
        else build_route(drive, spec.slope, initial_gap_m=gap_m, duration_s=spec.duration_s)
    )
    ticks = route.duration_s / spec.tick_s
    if abs(ticks - round(ticks)) > 1e-6 or round(ticks) < 1:
        raise ScenarioError(
            f"trip of {route.duration_s:g} s with ticks of {spec.tick_s:g} s; "
            "allowed: a whole number of ticks, at least one"
        )
    own = None
    if spec.controller_overrides:
        laid_over = {**dict(spec.overrides), **dict(spec.controller_overrides)}
        own = _parameters(spec.parameter_set, tuple(sorted(laid_over.items())))
    return RunInputs(spec, parameters, route, code_fingerprint(), address, own)


def run_key(inputs: RunInputs) -> str:
    """Key of everything that the numbers of a run depend on.

    Parameter sets and routes count with their values, not with their names or files: a change in one
    set leaves the runs of the others alone. Code counts without comments and docstrings.
    """
    spec, own = inputs.spec, inputs.controller_parameters
    strategy = asdict(spec.strategy)
    del strategy["name"]
    content = {
        "format": KEY_FORMAT,
        "kind": spec.kind.value,
        "parameters": to_flat_dict(inputs.parameters),
        "controller_parameters": None if own is None else to_flat_dict(own),
        "route": route_digest(inputs.route),
        "strategy": strategy,
        "horizon": spec.horizon,
        "solver": asdict(spec.solver),
        "preview": asdict(spec.bridge_settings()),
        "tick_s": spec.tick_s,
        "plant_step_s": spec.plant_step_s,
        "thermal_model": spec.thermal_model.value,
        "aging": asdict(AgingSettings.of(spec)),
        "charging_stop": asdict(ChargingStopSettings.of(spec)),
        "faults": plain_faults(spec.faults),
        "road": asdict(spec.road),
        "code": inputs.fingerprint,
    }
    return hashlib.sha256(canonical_json(content).encode()).hexdigest()[:KEY_LENGTH]


def route_digest(route: Route) -> str:
    """Digest of the numbers of a route."""
    digest = hashlib.sha256()
    scalars = np.array([route.duration_s, route.leader.start_position_m])
    leader, slope = route.leader, route.slope
    for values in (
        scalars,
        leader.times_s,
        leader.speeds_m_s,
        slope.positions_m,
        slope.slopes_rad,
    ):
        array = np.ascontiguousarray(values, dtype="<f8")
        digest.update(str(array.shape).encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


@lru_cache(maxsize=256)
def _parameters(name: str, overrides: tuple[tuple[str, float], ...]) -> ModelParameters:
    return load_parameters(name, dict(overrides)).values


@lru_cache(maxsize=32)
def _route(cycle: str, slope: str, initial_gap_m: float, duration_s: float | None) -> Route:
    return build_route(cycle, slope, initial_gap_m=initial_gap_m, duration_s=duration_s)
