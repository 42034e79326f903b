"""CasADi functions called on NumPy's own memory.

The usual call converts every argument to a CasADi matrix and back, checks names, and collects
statistics in a dictionary of all sub-functions: as long as half of a small solve.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from iptm_core.state import FloatArray


class BufferedFunction:
    """A function with arguments and results in place; one instance serves one thread.

    Attributes:
        arguments: by name; write the values of the next call into them. Zero at first.
        results: by name; overwritten by every call.
    """

    def __init__(
        self, function: ca.Function, memory: Mapping[str, FloatArray] | None = None
    ) -> None:
        """Allocate what is not given.

        Args:
            memory: arrays to use for arguments and results of these names, so that the results of one
                function can be the arguments of another without a copy.
        """
        given = memory or {}
        # CasADi's stubs describe the C++ signatures of the buffer, not the Python ones.
        self._buffer: Any
        self._buffer, self._run = function.buffer()
        self.arguments: dict[str, FloatArray] = {}
        self.results: dict[str, FloatArray] = {}
        for index in range(function.n_in()):
            name = function.name_in(index)
            self.arguments[name] = _array(given, name, function.nnz_in(index))
            self._buffer.set_arg(index, self.arguments[name].data)
        for index in range(function.n_out()):
            name = function.name_out(index)
            self.results[name] = _array(given, name, function.nnz_out(index))
            self._buffer.set_res(index, self.results[name].data)

    def __call__(self) -> None:
        """Evaluate; a `RuntimeError` means that CasADi broke off."""
        self._run()

    def stats(self) -> dict[str, Any]:
        """Return CasADi's statistics of the last call."""
        stats: dict[str, Any] = self._buffer.stats()
        return stats


def named_function(
    name: str, arguments: Mapping[str, Any], results: Mapping[str, Any], *, cse: bool = False
) -> ca.Function:
    """Return a function of symbols, by names given; with ``cse`` common subexpressions are computed once."""
    return ca.Function(
        name,
        list(arguments.values()),
        list(results.values()),
        list(arguments),
        list(results),
        {"cse": True} if cse else {},
    )


def _array(given: Mapping[str, FloatArray], name: str, size: int) -> FloatArray:
    array = given.get(name)
    if array is None:
        return np.zeros(size)
    if array.shape != (size,):
        raise ValueError(f"memory for '{name}' has shape {array.shape}, needed is ({size},)")
    return array
