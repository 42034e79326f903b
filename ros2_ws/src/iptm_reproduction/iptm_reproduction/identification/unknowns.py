"""What the paper leaves open, with bounds and reasons, read from one file; candidates are points in there.

Keys give the place of a number: ``composition.`` (order and slopes of the trip), ``parameters.`` (a dotted
key of the parameter sets), ``reference.`` (weights of the reference terms).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from iptm_controller.strategy import Strategy
from iptm_core.errors import ScenarioError
from iptm_core.parameters import load_parameters
from iptm_core.parameters.flat import field_specs
from iptm_core.parameters.model import ModelParameters
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.routes.comprehensive import SLOPE_KINDS, RouteComposition
from iptm_core.state import FloatArray
from iptm_core.user_input import StrictMapping

COMPOSITION, PARAMETERS, REFERENCE = "composition", "parameters", "reference"
_COMPOSITION_KEYS = tuple(
    entry.name
    for entry in fields(RouteComposition)
    if entry.name not in {"name", "order", "first_slope"}
)
_REFERENCE_KEYS = ("speed_weight", "temperature_weight", "reference_temperature_k")


@dataclass(frozen=True)
class Unknown:
    """A number that the paper does not state.

    Attributes:
        key: where it belongs, see the module.
        unit: its unit, that of the model.
        low: smallest value that makes sense.
        high: largest one.
        start: where a search begins: the prior.
        spread: standard deviation of the prior, in units of the range from ``low`` to ``high``.
        reason: why these bounds and this prior.
    """

    key: str
    unit: str
    low: float
    high: float
    start: float
    spread: float
    reason: str

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and self.low < self.high < math.inf):
            raise ScenarioError(f"{self.key}: {self.low} to {self.high}; allowed: a range")
        if not self.low <= self.start <= self.high:
            raise ScenarioError(
                f"{self.key}: start is {self.start}; allowed: {self.low:g} to {self.high:g}"
            )
        if not self.spread > 0.0:
            raise ScenarioError(f"{self.key}: spread is {self.spread}; allowed: above 0")

    @property
    def deviation(self) -> float:
        """Standard deviation of the prior."""
        return self.spread * (self.high - self.low)

    def place(self, value: float) -> float:
        """Place of a value from 0 (low) to 1 (high)."""
        return (value - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class Settled:
    """A number that is not searched for, and why."""

    key: str
    unit: str
    value: float
    reason: str


@dataclass(frozen=True)
class Unknowns:
    """Everything that is searched for, and everything that deliberately is not.

    ``order`` and ``first_slope`` are those of the trip, ``base_set`` states all other parameters, and
    ``weights`` are those of the energy and aging terms by strategy.
    """

    order: tuple[str, ...]
    first_slope: str
    base_set: str
    free: tuple[Unknown, ...]
    settled: tuple[Settled, ...]
    weights: Mapping[str, Mapping[str, float]]

    @cached_property
    def start(self) -> FloatArray:
        """Places of the priors, shape (n,)."""
        return np.array([unknown.place(unknown.start) for unknown in self.free])

    @cached_property
    def spreads(self) -> FloatArray:
        """Standard deviations of the priors, shape (n,)."""
        return np.array([unknown.spread for unknown in self.free])

    def candidate(self, places: FloatArray) -> Candidate:
        """Return the candidate at places in the unit cube, shape (n,); places outside are cut off."""
        values = {entry.key: entry.value for entry in self.settled}
        for unknown, place in zip(self.free, np.clip(places, 0.0, 1.0), strict=True):
            value = unknown.low + float(place) * (unknown.high - unknown.low)
            values[unknown.key] = float(f"{value:.5g}")
        return Candidate(self, values)

    def places(self, values: Mapping[str, float]) -> FloatArray:
        """Return the places of the free numbers of a candidate, shape (n,)."""
        return np.array([unknown.place(values[unknown.key]) for unknown in self.free])


@dataclass(frozen=True)
class Candidate:
    """One choice of all numbers, by key, settled ones included."""

    unknowns: Unknowns
    values: Mapping[str, float]

    def section(self, name: str) -> dict[str, float]:
        """Values of a section by the rest of their key."""
        prefix = f"{name}."
        return {
            key.removeprefix(prefix): value
            for key, value in self.values.items()
            if key.startswith(prefix)
        }

    def composition(self, name: str) -> RouteComposition:
        """The trip, under a name of its own."""
        numbers: dict[str, Any] = self.section(COMPOSITION)
        return RouteComposition(name, self.unknowns.order, self.unknowns.first_slope, **numbers)

    def parameters(self) -> ModelParameters:
        """The model."""
        return load_parameters(self.unknowns.base_set, self.section(PARAMETERS)).values

    def strategy(self, strategy: Strategy) -> Strategy:
        """A strategy with the weights of this study, and of this candidate where it tracks references."""
        weights: dict[str, Any] = dict(self.unknowns.weights.get(strategy.name, {}))
        if strategy.temperature_weight > 0.0:
            weights |= self.section(REFERENCE)
        return replace(strategy, **weights)


def shipped_unknowns() -> Path:
    """File of the unknowns of the paper; the packages are installed as plain folders."""
    return Path(str(resources.files("iptm_reproduction.identification") / "unknowns.yaml"))


def read_unknowns(path: Path) -> Unknowns:
    """Read the file of the unknowns.

    Raises:
        ScenarioError: something in it is not as it should be.
    """
    content = StrictMapping(
        read_yaml(path, ScenarioError),
        str(path),
        ("description", "trip", "base_set", "free", "settled", "weights"),
    )
    content.require("trip", "base_set", "free", "settled", "weights")
    trip = content.section("trip", ("order", "first_slope", "reason"))
    free, settled = content.section("free"), content.section("settled")
    twice = sorted(set(free) & set(settled))
    if twice:
        raise ScenarioError(f"{path}: {twice[0]} is both free and settled; allowed: one of both")
    weights = content.section("weights")
    return Unknowns(
        tuple(str(part) for part in trip.entries("order")),
        trip.choice("first_slope", SLOPE_KINDS),
        content.text("base_set"),
        tuple(_unknown(free, key) for key in free),
        tuple(_settled(settled, key) for key in settled),
        {
            name: {key: entry.number(key) for key in entry}
            for name in weights
            if (entry := weights.section(name))
        },
    )


def _unknown(content: StrictMapping, key: str) -> Unknown:
    names = tuple(entry.name for entry in fields(Unknown) if entry.name != "key")
    entry = content.section(key, names)
    entry.require(*names)
    numbers = {name: entry.number(name) for name in ("low", "high", "start", "spread")}
    return Unknown(_known(key), unit=entry.text("unit"), reason=entry.text("reason"), **numbers)


def _settled(content: StrictMapping, key: str) -> Settled:
    entry = content.section(key, ("unit", "value", "reason"))
    entry.require("unit", "value", "reason")
    return Settled(_known(key), entry.text("unit"), entry.number("value"), entry.text("reason"))


def _known(key: str) -> str:
    """Refuse a key that names nothing."""
    section, _, name = key.partition(".")
    known = {
        COMPOSITION: _COMPOSITION_KEYS,
        PARAMETERS: tuple(field_specs()),
        REFERENCE: _REFERENCE_KEYS,
    }
    if name not in known.get(section, ()):
        raise ScenarioError(
            f"unknown number {key!r}; allowed: a key of {', '.join(known)}, such as "
            f"{COMPOSITION}.{_COMPOSITION_KEYS[0]}"
        )
    return key
