"""A fault as data (kind, time, frequency, size), and the list of faults in a scenario file.

faults:
  - {kind: preview_lost, start_s: 60, duration_s: 20, probability: 0.5, seed: 3}
  - {kind: leader_hard_stop, start_s: 120, duration_s: 15, size: 8}
  - {kind: process_restarted, start_s: 200, target: controller}
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from iptm.faults.effects import Hit
from iptm.faults.kinds import FaultKind, FaultPlace, KindSpec
from iptm_core.declaration import ParameterSpec, Scalar, Settings, parameter, plain
from iptm_core.errors import ParameterError, ScenarioError
from iptm_core.settings import MAX_SEED, LeaderSource, LoopMode
from iptm_core.state import NS_PER_S
from iptm_core.user_input import StrictMapping

TARGETS = ("plant", "v2x_bridge", "controller", "recorder")
"""Processes of a run that a fault may hit."""

WHOLE_TRIP_S = 1e5
"""Faults of this duration last to the end of any trip."""

_NEED_NO_DURATION = (FaultPlace.PROCESS,)
_SIZE = ParameterSpec("", 0.0, "how large it is, see the kind", optional=True)


@dataclass(frozen=True)
class Fault(Settings):
    """Something that goes wrong for a while.

    Attributes:
        size: how large it is, in the unit of the kind; None takes the size of the kind.

    Raises:
        ParameterError: a value is out of range, or the kind has no such thing.
    """

    kind: FaultKind = parameter(FaultKind.PREVIEW_LOST, "what goes wrong")
    start_s: float = parameter(0.0, "trip time at which it begins", "s", 0.0, 1e6)
    duration_s: float = parameter(10.0, "how long it lasts in trip time", "s", 0.0, 1e6)
    probability: float = parameter(
        1.0,
        "share of the ticks hit; of an event in traffic or of a process, that it happens",
        "",
        0.0,
        1.0,
    )
    seed: int = parameter(0, "seed of everything random about it", "", 0, MAX_SEED)
    size: float | None = field(default=None, metadata={"spec": _SIZE})
    target: str = parameter(
        "",
        "process that it hits; the controller (of disk_full the recorder) unless stated",
        choices=("", *TARGETS),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        spec = self.spec
        size = spec.size if self.size is None and spec.has_size else self.size
        if self.size is not None and not spec.has_size:
            raise ParameterError(f"size is {self.size:g}; allowed: none, {self.kind} has no size")
        if size is not None and not spec.smallest <= size <= spec.largest:
            raise ParameterError(
                f"size is {size:g}; allowed: {spec.smallest:g} to {spec.largest:g} {spec.unit}"
            )
        if spec.whole and size is not None and size != round(size):
            raise ParameterError(f"size is {size:g}; allowed: a whole number of {spec.unit}")
        object.__setattr__(self, "size", size)
        hits_process = spec.place is FaultPlace.PROCESS
        if hits_process and not self.target:
            object.__setattr__(self, "target", _usual_target(self.kind))
        if self.target and not hits_process:
            raise ParameterError(f"target is '{self.target}'; allowed: none, {self.kind} hits none")

    @property
    def spec(self) -> KindSpec:
        """What its kind is."""
        return self.kind.spec

    @property
    def magnitude(self) -> float:
        """The size in the unit of the kind, NaN where it has none."""
        return float("nan") if self.size is None else self.size

    def effect_on(self, value: Any, time_ns: int, **hit: Any) -> Any:
        """Return what arrives instead of a measured value; see ``effects``."""
        if self.spec.effect is None:
            raise AssertionError(f"{self.kind} has no effect on a measured value")
        return self.spec.effect(Hit(self, time_ns, **hit), value)

    @property
    def start_ns(self) -> int:
        """First instant of trip time, integer nanoseconds."""
        return round(self.start_s * NS_PER_S)

    @property
    def end_s(self) -> float:
        """Trip time at which it is over."""
        return self.start_s + self.duration_s

    def covers(self, time_ns: int) -> bool:
        """Return whether an instant lies between its beginning and its end."""
        return self.start_ns <= time_ns < round(self.end_s * NS_PER_S)

    def hits(self, time_ns: int) -> bool:
        """Return whether the tick at an instant is hit; the same for every caller."""
        if not self.covers(time_ns):
            return False
        return self.probability >= 1.0 or self.random(time_ns).random() < self.probability

    def happens(self) -> bool:
        """Return whether an event that happens as a whole or not at all takes place."""
        return self.probability >= 1.0 or self.random(self.start_ns).random() < self.probability

    def random(self, time_ns: int, *stream: int) -> np.random.Generator:
        """Return a generator that depends on seed, kind, instant and stream only, never on earlier draws."""
        kind = zlib.crc32(self.kind.value.encode())
        return np.random.default_rng([self.seed, kind, time_ns & (2**64 - 1), *stream])

    def to_dict(self) -> dict[str, Scalar]:
        """Return what differs from the defaults, as files and messages hold it."""
        content: dict[str, Scalar] = {"kind": self.kind.value, "start_s": self.start_s}
        for entry in fields(self):
            value = getattr(self, entry.name)
            usual = self.spec.size if entry.name == "size" else entry.default
            if entry.name not in content and value not in (None, usual):
                content[entry.name] = plain(value)
        return content

    def describe(self) -> str:
        """Return one line for people."""
        parts = [str(self.kind)]
        if self.spec.has_size and self.magnitude:
            parts.append(f"{self.magnitude:g} {self.spec.unit}")
        if self.target:
            parts.append(self.target)
        lasting = self.duration_s >= WHOLE_TRIP_S
        if not (lasting and self.start_s == 0.0):
            parts.append(f"at {self.start_s:g} s")
        if self.spec.place not in _NEED_NO_DURATION:
            parts.append("to the end" if lasting else f"for {self.duration_s:g} s")
        if self.probability < 1.0:
            parts.append(f"in {100.0 * self.probability:g} % of the ticks")
        return " ".join(parts)


def faults_from(entries: object, where: str) -> tuple[Fault, ...]:
    """Read a list of faults.

    Returns:
        The faults in the order of their beginning.

    Raises:
        ScenarioError: no list, an unknown key or kind, or a value that is not allowed.
    """
    listed = StrictMapping({"faults": entries}, where).entries("faults", may_be_empty=True)
    names = [entry.name for entry in fields(Fault)]
    faults = []
    for number, content in enumerate(listed, start=1):
        place = f"{where}: fault {number}"
        written = StrictMapping(content, place, names)
        written.choice("kind", [kind.value for kind in FaultKind])
        given: dict[str, Any] = {name: written.scalar(name) for name in written}
        try:
            faults.append(Fault(**given))
        except ParameterError as error:
            raise ScenarioError(f"{place}: {error}") from None
    return in_order(faults)


def in_order(faults: Iterable[Fault]) -> tuple[Fault, ...]:
    """Return faults in the order of their beginning."""
    return tuple(sorted(faults, key=lambda fault: fault.start_s))


def at_places(faults: Iterable[Fault], *places: FaultPlace) -> tuple[Fault, ...]:
    """Return the faults that take place at one of several places."""
    return tuple(fault for fault in faults if fault.spec.place in places)


def plain_faults(faults: Iterable[Fault]) -> list[Mapping[str, Scalar]]:
    """Return faults as files hold them; `faults_from` reads them back."""
    return [fault.to_dict() for fault in faults]


def _usual_target(kind: FaultKind) -> str:
    return "recorder" if kind is FaultKind.DISK_FULL else "controller"


@dataclass(frozen=True)
class FaultSettings(Settings):
    """The faults of a run as one text, as a parameter can hold them."""

    faults: str = parameter("[]", "list of faults as JSON, keys as in a scenario file")

    def listed(self) -> tuple[Fault, ...]:
        """Return the faults.

        Raises:
            ScenarioError: the text is not a list of faults.
        """
        try:
            entries = json.loads(self.faults)
        except ValueError as error:
            raise ScenarioError(f"faults are not valid JSON: {error}; allowed: a list") from None
        return faults_from(entries, "parameter faults")


@dataclass(frozen=True)
class InjectorNodeParameters(FaultSettings):
    """Parameters of the injector."""

    mode: LoopMode = parameter(
        LoopMode.REAL_TIME,
        "of the trip; lock_step: an empty prediction in place of one that is lost, for which the "
        "controller would wait by the wall clock",
    )


def check_empty_road(leader_source: LeaderSource, faults: Iterable[Fault]) -> None:
    """Refuse faults of a lead vehicle that is not there."""
    of_leader = {FaultPlace.TRAFFIC, FaultPlace.LEADER, FaultPlace.PREVIEW}
    for fault in faults:
        if leader_source is LeaderSource.NONE and fault.spec.place in of_leader:
            allowed = ", ".join(kind for kind in FaultKind if kind.spec.place not in of_leader)
            raise ScenarioError(
                f"fault is {fault.kind} with leader_source none; allowed: {allowed}"
            )


# True values keep their names for recorders and viewers: the plant's topics, and `v2x/leader` and
# `v2x/leader_preview` of the effective leader. The faulty inputs of controller and bridge have their own
# names, to which these inputs are remapped, and so have the bridge's outputs for the leader of the route.


def faulty_name(topic: str) -> str:
    """Return the name of a topic with faults applied, as its receiver subscribes to it."""
    return "faults/faulty/" + topic.lstrip("/")


def route_name(topic: str) -> str:
    """Return the name under which the bridge publishes a topic of the route's leader."""
    return "faults/route/" + topic.lstrip("/")
