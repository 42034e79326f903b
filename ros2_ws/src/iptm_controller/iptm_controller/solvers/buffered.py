"""CasADi functions called on NumPy's own memory.

The usual call converts every argument to a CasADi matrix and back, checks names, and collects
statistics in a dictionary of all sub-functions: as long as half of a small solve.
"""

from __future__ import annotations

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

    def __init__(self, function: ca.Function) -> None:
        # CasADi's stubs describe the C++ signatures of the buffer, not those of Python.
        self._buffer: Any
        self._buffer, self._run = function.buffer()
        self.arguments: dict[str, FloatArray] = {}
        self.results: dict[str, FloatArray] = {}
        for index in range(function.n_in()):
            memory = np.zeros(function.nnz_in(index))
            self._buffer.set_arg(index, memory.data)
            self.arguments[function.name_in(index)] = memory
        for index in range(function.n_out()):
            memory = np.zeros(function.nnz_out(index))
            self._buffer.set_res(index, memory.data)
            self.results[function.name_out(index)] = memory

    def __call__(self) -> None:
        """Evaluate.

        Raises:
            RuntimeError: CasADi broke off.
        """
        self._run()

    def stats(self) -> dict[str, Any]:
        """CasADi's statistics of the last call."""
        stats: dict[str, Any] = self._buffer.stats()
        return stats
