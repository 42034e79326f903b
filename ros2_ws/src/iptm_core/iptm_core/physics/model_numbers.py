"""The numbers of a model as one vector of parameters of every generated function.

Code generated from expressions with symbols in place of the numbers serves any car: drag, resistances, gaps
and all others are data. A number that takes an effect out of the equations (0, 1 or the neutral value of its
declaration) stays in them, so that code has the effects of its cars only; models with the same effects have
the same shape.

What depends on numbers alone is computed once for a car and not at every call, see `split_off`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import Field, astuple, dataclass, fields, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.ops import named_function
from iptm_core.physics.thermal_loop import Channel, ChannelWeights, reduce_channel
from iptm_core.state import FloatArray

NUMBERS = "numbers"
"""Argument of functions that takes the vector."""
_WEIGHTS = len(fields(Channel)) * len(fields(ChannelWeights))


def shape_of(model: ModelParameters) -> ModelParameters:
    """Return a model with NaN in place of numbers that are data; equal for models that share their code."""
    groups = {}
    for group in fields(model):
        parameters = getattr(model, group.name)
        data = {
            entry.name: math.nan
            for entry in fields(parameters)
            if not _stays(getattr(parameters, entry.name), entry)
        }
        groups[group.name] = replace(parameters, **data)
    return replace(model, **groups)


def _stays(value: float, entry: Field[float]) -> bool:
    is_count = entry.metadata["spec"].kind is int
    return not is_count and value in (0.0, 1.0, entry.default)


@dataclass(frozen=True)
class SymbolicModel:
    """A model of expressions.

    Attributes:
        parameters: numbers are entries of the vector, or literals.
        channel: weights of the coolant channel: a sum over its cells, computed ahead.
        numbers: symbol of the vector, see `numbers_of`.
    """

    parameters: ModelParameters
    channel: Channel
    numbers: ca.SX

    @classmethod
    def of(cls, shape: ModelParameters) -> SymbolicModel:
        """Return the model of a shape."""
        places = _places(shape)
        numbers = ca.SX.sym(NUMBERS, len(places) + _WEIGHTS)
        groups: dict[str, dict[str, ca.SX]] = {}
        for (group, name), symbol in zip(places, ca.vertsplit(numbers), strict=False):
            groups.setdefault(group, {})[name] = symbol
        given = {
            group: replace(getattr(shape, group), **symbols) for group, symbols in groups.items()
        }
        weights = ca.vertsplit(numbers[len(places) :])
        half = _WEIGHTS // 2
        channel = Channel(ChannelWeights(*weights[:half]), ChannelWeights(*weights[half:]))
        return cls(replace(shape, **given), channel, numbers)

    @classmethod
    def literal(cls, model: ModelParameters) -> SymbolicModel:
        """Return a model whose numbers are all literals; the vector is empty."""
        return cls(model, reduce_channel(model.cooling, model.pack), ca.SX.sym(NUMBERS, 0))


def numbers_of(model: ModelParameters, shape: ModelParameters) -> FloatArray:
    """Return the numbers of a model of a shape, in the order of `SymbolicModel.numbers`."""
    own = [getattr(getattr(model, group), name) for group, name in _places(shape)]
    channel = reduce_channel(model.cooling, model.pack)
    return np.array([*own, *astuple(channel.last_cell), *astuple(channel.outlet)], dtype=float)


@lru_cache(maxsize=64)
def _places(shape: ModelParameters) -> tuple[tuple[str, str], ...]:
    return tuple(
        (group.name, entry.name)
        for group in fields(shape)
        for entry in fields(getattr(shape, group.name))
        if math.isnan(getattr(getattr(shape, group.name), entry.name))
    )


@dataclass(frozen=True)
class SplitFunctions:
    """Functions of what changes from call to call, and what they need of a model.

    Attributes:
        functions: in their order; `NUMBERS`, now the last argument, takes the results of ``prepared``.
        prepared: from the numbers of a model to what depends on them alone.
    """

    functions: list[ca.Function]
    prepared: ca.Function

    def prepare(self, numbers: FloatArray) -> FloatArray:
        """Return what the functions take for a model."""
        values: FloatArray = np.array(self.prepared(numbers)).ravel()
        return values


def split_off(functions: Sequence[ca.Function]) -> SplitFunctions:
    """Take what depends on the numbers of a model alone out of functions, each of which has `NUMBERS`."""
    numbers = ca.SX.sym(NUMBERS, functions[0].size1_in(NUMBERS))
    given: list[dict[str, ca.SX]] = []
    found: list[ca.SX] = []
    for function in functions:
        arguments = {name: function.sx_in(name) for name in function.name_in()}
        arguments[NUMBERS] = numbers
        given.append(arguments)
        found += function.call([*arguments.values()])
    found, symbols, values = ca.extract_parametric(found, numbers, {"extract_trivial": True})
    taken = ca.vertcat(*symbols)
    split = []
    for function, arguments in zip(functions, given, strict=True):
        own, found = found[: function.n_out()], found[function.n_out() :]
        del arguments[NUMBERS]
        results = dict(zip(function.name_out(), own, strict=True))
        split.append(
            named_function(function.name(), {**arguments, NUMBERS: taken}, results, cse=True)
        )
    return SplitFunctions(split, ca.Function("prepared", [numbers], [ca.vertcat(*values)]))
