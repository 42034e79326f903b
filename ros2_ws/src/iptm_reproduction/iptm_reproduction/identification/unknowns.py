"""What the paper leaves open, with bounds and reasons, read from one file; candidates are points in there.

Keys give the place of a number: ``composition.`` (order and slopes of the trip), ``parameters.`` (a dotted
key of the parameter sets), ``reference.`` (weights of the reference terms).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

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
class Unknowns:
    """Everything that is searched for, and everything that deliberately is not.

    Attributes:
        order: segments of the trip.
        first_slope: kind of its first slope.
        base_set: states all other parameters.
        free: what is searched for, a row per key (see the module): ``unit``, ``low`` and ``high`` (bounds of
            what makes sense), ``start`` (where a search begins, the prior), ``spread`` (standard deviation of
            the prior, in units of the range) and ``reason`` (of bounds and prior).
        settled: what is not searched for, a row per key: ``unit``, ``value`` and ``reason``.
        weights: those of the energy and aging terms, by strategy.
    """

    order: tuple[str, ...]
    first_slope: str
    base_set: str
    free: pd.DataFrame
    settled: pd.DataFrame
    weights: Mapping[str, Mapping[str, float]]

    @property
    def start(self) -> FloatArray:
        """Places of the priors, shape (n,)."""
        return self.places(self.free["start"])

    @property
    def spreads(self) -> FloatArray:
        """Standard deviations of the priors in units of the ranges, shape (n,)."""
        return np.asarray(self.free["spread"], dtype=np.float64)

    @property
    def deviations(self) -> FloatArray:
        """Standard deviations of the priors, shape (n,)."""
        ranges: FloatArray = np.asarray(self.free["high"] - self.free["low"], dtype=np.float64)
        return self.spreads * ranges

    def candidate(self, places: FloatArray) -> Candidate:
        """Return the candidate at places in the unit cube, shape (n,); places outside are cut off."""
        low, high = self.free["low"], self.free["high"]
        found = low + np.clip(places, 0.0, 1.0) * (high - low)
        values = {key: float(f"{value:.5g}") for key, value in found.items()}
        return Candidate(self, {**self.settled["value"].to_dict(), **values})

    def places(self, values: Mapping[str, float]) -> FloatArray:
        """Return the places of the free numbers of a candidate from 0 (low) to 1 (high), shape (n,)."""
        low, high = self.free["low"].to_numpy(), self.free["high"].to_numpy()
        found = np.array([values[key] for key in self.free.index])
        return np.asarray((found - low) / (high - low), dtype=np.float64)


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
    free = _table(content.section("free"), ("low", "high", "start", "spread"))
    settled = _table(content.section("settled"), ("value",))
    twice = sorted(set(free.index) & set(settled.index))
    if twice:
        raise ScenarioError(f"{path}: {twice[0]} is both free and settled; allowed: one of both")
    for row in free.itertuples():
        if not (math.isfinite(row.low) and row.low < row.high < math.inf):
            raise ScenarioError(f"{row.Index}: {row.low} to {row.high}; allowed: a range")
        if not row.low <= row.start <= row.high:
            raise ScenarioError(
                f"{row.Index}: start is {row.start}; allowed: {row.low:g} to {row.high:g}"
            )
        if not row.spread > 0.0:
            raise ScenarioError(f"{row.Index}: spread is {row.spread}; allowed: above 0")
    weights = content.section("weights")
    return Unknowns(
        tuple(str(part) for part in trip.entries("order")),
        trip.choice("first_slope", SLOPE_KINDS),
        content.text("base_set"),
        free,
        settled,
        {
            name: {key: entry.number(key) for key in entry}
            for name in weights
            if (entry := weights.section(name))
        },
    )


def _table(content: StrictMapping, numbers: tuple[str, ...]) -> pd.DataFrame:
    """Return the entries of a section by key, each with unit, some numbers and a reason."""
    names = ("unit", *numbers, "reason")
    rows = {}
    for key in content:
        entry = content.section(key, names)
        entry.require(*names)
        texts = {name: entry.text(name) for name in ("unit", "reason")}
        rows[_known(key)] = texts | {name: entry.number(name) for name in numbers}
    return pd.DataFrame.from_dict(rows, orient="index")


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
