"""Studies as data: named cases, each one run as planned, with the key under which its result is stored.

A case looks up the numbers behind the names of its specification when they are needed; they travel with it to
the process that performs the run. Code counts in the key without comments, docstrings and layout. Nodes,
metrics (recomputed from the stored run) and files of parameter sets and cycles (their values are in the key)
do not count as code.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np

import iptm.faults
import iptm_controller
import iptm_core
import iptm_plant_sim
import iptm_v2x_bridge
from iptm.faults.fault import plain_faults
from iptm.studies.run_spec import RunSpec, canonical_json
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.charging_stop import ChargingStopSettings
from iptm_core.errors import ScenarioError
from iptm_core.metrics import RunMetrics
from iptm_core.parameters import load_parameters, to_flat_dict
from iptm_core.parameters.model import ModelParameters
from iptm_core.provenance import installed_version
from iptm_core.routes import Route, build_route
from iptm_core.routes.comprehensive import RouteComposition
from iptm_core.routes.user_csv import UserTrip

Label = str | int | float
DEFAULT_CRITERION = "total_degradation"
SHORT_TRIP: dict[str, Any] = {"cycle": "us06", "slope": "small", "duration_s": 600.0}
"""What all runs of a small version drive: ten lively minutes, the whole US06 cycle over gentle hills."""
NOT_COMPUTED = "not computed"
KEY_FORMAT = 1
KEY_LENGTH = 32
_PACKAGES = (iptm_core, iptm_plant_sim, iptm_v2x_bridge, iptm_controller, iptm.faults)
_OWN_MODULES = ("channel_record.py", "closed_loop.py", "studies/run.py", "whole_trip.py")
_LIBRARIES = ("casadi", "numpy")


@dataclass(frozen=True)
class Selection:
    """Take the strategy of the best run of another study, as the paper does for its weighted strategies.

    Attributes:
        study: name of the other study.
        labels: only its cases with these labels count; empty for all.
        lowest: key of the figure that decides (see ``iptm_core.metrics.FIGURES``), smaller is better.
            Runs that break a hard limit come last, whatever their figure.
    """

    study: str
    labels: Mapping[str, Label] = field(default_factory=dict)
    lowest: str = DEFAULT_CRITERION

    def matches(self, case: Case) -> bool:
        """True if a case of the other study counts."""
        return all(case.labels.get(name) == value for name, value in self.labels.items())


@dataclass
class Case:
    """A run as planned, and where it stands in a campaign.

    Attributes:
        name: unique in its study.
        labels: what varies, by name, for tables and plots.
        best_of: where the strategy comes from that is still to be found; until then, that of ``spec`` stands
            in. None where the strategy is known.
        study: name of its study.
        drive: what the leader drives where the cycle of the specification is but a name.
        metrics: what the run achieved; None while it is not there.
        reason: why it is not there; empty if it is.
    """

    name: str
    labels: Mapping[str, Label]
    spec: RunSpec
    best_of: Selection | None = None
    study: str = ""
    drive: UserTrip | RouteComposition | None = None
    metrics: RunMetrics | None = field(default=None, compare=False)
    reason: str = field(default=NOT_COMPUTED, compare=False)

    @property
    def address(self) -> str:
        """``study/case``; the name alone outside a study."""
        return f"{self.study}/{self.name}" if self.study else self.name

    @cached_property
    def parameters(self) -> ModelParameters:
        """Parameters of the vehicle."""
        return _parameters(self.spec.parameter_set, self.spec.overrides)

    @cached_property
    def controller_parameters(self) -> ModelParameters | None:
        """Parameters of the controller where its model is not that of the vehicle, None where it is."""
        if not self.spec.controller_overrides:
            return None
        laid_over = {**dict(self.spec.overrides), **dict(self.spec.controller_overrides)}
        return _parameters(self.spec.parameter_set, tuple(sorted(laid_over.items())))

    @cached_property
    def route(self) -> Route:
        """Leader and road."""
        spec, gap_m = self.spec, self.parameters.gap.initial_gap_m
        if self.drive is None:
            return _route(spec.cycle, spec.slope, gap_m, spec.duration_s)
        return build_route(self.drive, spec.slope, initial_gap_m=gap_m, duration_s=spec.duration_s)

    @cached_property
    def ticks(self) -> int:
        """Number of decisions in the run."""
        ticks = self.route.duration_s / self.spec.tick_s
        if abs(ticks - round(ticks)) > 1e-6 or round(ticks) < 1:
            raise ScenarioError(
                f"trip of {self.route.duration_s:g} s with ticks of {self.spec.tick_s:g} s; "
                "allowed: a whole number of ticks, at least one"
            )
        return round(ticks)

    @cached_property
    def fingerprint(self) -> str:
        """Digest of the code and libraries that the run is meant for."""
        return code_fingerprint()

    @cached_property
    def key(self) -> str:
        """Key of everything that the numbers of the run depend on.

        Parameter sets and routes count with their values, not with their names or files: a change in one
        set leaves the runs of the others alone.
        """
        spec, own = self.spec, self.controller_parameters
        strategy = asdict(spec.strategy)
        del strategy["name"]
        content = {
            "format": KEY_FORMAT,
            "kind": spec.kind.value,
            "parameters": to_flat_dict(self.parameters),
            "controller_parameters": None if own is None else to_flat_dict(own),
            "route": route_digest(self.route),
            "strategy": strategy,
            "horizon": spec.horizon,
            "solver": spec.solver_settings,
            "preview": asdict(spec.bridge_settings()),
            "tick_s": spec.tick_s,
            "plant_step_s": spec.plant_step_s,
            "thermal_model": spec.thermal_model.value,
            "aging": asdict(AgingSettings.of(spec)),
            "charging_stop": asdict(ChargingStopSettings.of(spec)),
            "faults": plain_faults(spec.faults),
            "road": asdict(spec.road),
            "code": self.fingerprint,
        }
        return hashlib.sha256(canonical_json(content).encode()).hexdigest()[:KEY_LENGTH]

    def check(self) -> Case:
        """Return this case if its run can be set up; raises an IptmError otherwise."""
        _ = self.ticks, self.controller_parameters
        return self


def planned_run(
    spec: RunSpec, name: str = "", drive: UserTrip | RouteComposition | None = None
) -> Case:
    """Return a run that belongs to no study; with a drive, the cycle of the specification is but its name.

    Raises:
        IptmError: a name, a key, a value or a file is not usable.
    """
    return Case(name, {}, spec, drive=drive).check()


@dataclass(frozen=True)
class Study:
    """A set of runs that belong together; ``about`` is what it shows, a few sentences."""

    name: str
    title: str
    about: str
    cases: tuple[Case, ...]

    def __post_init__(self) -> None:
        names = [case.name for case in self.cases]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ScenarioError(
                f"study {self.name}: the case name {twice[0]!r} occurs more than once; "
                "allowed: different names"
            )
        for case in self.cases:
            case.study = self.name

    def shortened(self, **settings: Any) -> Study:
        """Return the same cases with other settings of their runs, such as a shorter trip."""
        cases = (replace(case, spec=replace(case.spec, **settings)) for case in self.cases)
        return replace(self, cases=tuple(cases))


@dataclass(frozen=True)
class Judged:
    """A trial, what was found in it, and what of that did not hold.

    Attributes:
        name: of the trial, and how it was driven.
        what: the trial in words.
        labels: what tables group it by.
        figures: what was found, by name; a figure that does not exist is left out.
        problems: what did not hold, in words, by the name of the requirement.
        counts: what occurred how often.
    """

    name: str
    what: str
    labels: Mapping[str, Label] = field(default_factory=dict)
    figures: Mapping[str, float] = field(default_factory=dict)
    problems: Mapping[str, str] = field(default_factory=dict)
    counts: Mapping[str, int] = field(default_factory=dict)

    @property
    def problem_text(self) -> str:
        """What did not hold, in one line; empty if everything did."""
        return ", ".join(self.problems.values())


def route_digest(route: Route) -> str:
    """Return the digest of the numbers of a route."""
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


@lru_cache(maxsize=1)
def code_fingerprint() -> str:
    """Return the digest of code and libraries, as they were when the process asked first."""
    digest = hashlib.sha256()
    for name, path in sorted(source_files().items()):
        digest.update(f"{name}\0{normalised_source(path)}\0".encode())
    for library in _LIBRARIES:
        digest.update(f"{library}\0{installed_version(library)}\0".encode())
    return digest.hexdigest()


def source_files() -> dict[str, Path]:
    """Return the files that count, by ``package/path``."""
    here = Path(__file__).parents[1]
    files = {f"{here.name}/{name}": here / name for name in _OWN_MODULES}
    for package in _PACKAGES:
        folder = Path(str(package.__file__)).parent
        for path in folder.rglob("*.py"):
            inside = path.relative_to(folder)
            if not path.name.startswith("node") and inside.parts[0] != "metrics":
                files[f"{folder.name}/{inside.as_posix()}"] = path
    return files


def normalised_source(path: Path) -> str:
    """Return a source text without comments, docstrings and layout.

    Raises:
        ScenarioError: the file cannot be read.
    """
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError) as error:
        raise ScenarioError(f"source file {path.name} cannot be read: {error}") from error
    return ast.unparse(_WithoutDocstrings().visit(tree))


class _WithoutDocstrings(ast.NodeTransformer):
    """Removes every statement that is nothing but a constant: it has no effect."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        return None if isinstance(node.value, ast.Constant) else node
