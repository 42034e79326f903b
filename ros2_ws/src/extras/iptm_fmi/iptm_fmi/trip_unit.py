"""An FMU that goes along with a trip, its variables by what they are for the suite."""

from __future__ import annotations

import math
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from iptm_core.errors import StateError
from iptm_fmi.foreign_unit import ForeignUnit
from iptm_fmi.mapping import ENERGIES, VariableMap, check_units, default_mapping, read_mapping

_SAME_S = 1e-6


class TripUnit:
    """An FMU where a trip stands: it goes on, to the start, or by one interval back where it saves states.

    Attributes:
        file: that it is from.
        map: its variables by what they are.
        found: values of its outputs, in the units of the suite.
        has_begun: whether a trip stands anywhere.
    """

    def __init__(self, file: Path) -> None:
        """Load an FMU and its mapping.

        Raises:
            ScenarioError: they cannot be used.
        """
        self.file = file
        self._unit = ForeignUnit(file)
        weakref.finalize(self, self._unit.close)
        self.map: VariableMap = read_mapping(file) or default_mapping(self._unit.units)
        check_units(self.map, self._unit.units)
        self._names = [mapped.name for mapped in self.map.outputs.values()]
        self._start_s = self._time_s = math.nan
        self._before: tuple[float, Any, dict[str, float]] | None = None
        self._sums: dict[str, float] = {}
        self.found: dict[str, float] = {}

    @property
    def has_begun(self) -> bool:
        """Whether a trip has begun."""
        return not math.isnan(self._time_s)

    def begin(self, time_s: float) -> None:
        """Go to the start of a trip."""
        self._forget()
        self._unit.start(time_s)
        self._start_s = self._time_s = time_s
        self._read()
        self._sums = self._energies()

    def advance(self, given: Mapping[str, float], time_s: float, duration_s: float) -> None:
        """Drive an interval.

        Args:
            given: values of inputs by what they are; those that the FMU does not have are left out.
            time_s: at which the interval begins: where the FMU is, where it was before, or the start.

        Raises:
            StateError: the FMU cannot go there, fails, or answers what is not finite.
        """
        self._go_to(time_s)
        if self._unit.step_s is not None and abs(duration_s - self._unit.step_s) > _SAME_S:
            raise StateError(
                f"{self.file.name} takes steps of {self._unit.step_s:g} s only, and {duration_s:g} s are"
                " needed; allowed: steps of any length, or no safety monitor"
            )
        self._sums = self._energies()
        if self._unit.keeps_states:
            self._forget()
            self._before = self._time_s, self._unit.state(), dict(self.found)
        inputs = self.map.inputs.items()
        self._unit.put({each.name: each.to_fmu(given[what]) for what, each in inputs})
        self._unit.step(self._time_s, duration_s)
        self._time_s = time_s + duration_s
        self._read()

    def mean_w(self, name: str, duration_s: float) -> float:
        """Return the mean power of the last interval from a sum of energies; NaN where the FMU has none."""
        if name not in self.found:
            return math.nan
        return (self.found[name] - self._sums[name]) / duration_s if duration_s > 0.0 else 0.0

    def _energies(self) -> dict[str, float]:
        return {name: value for name, value in self.found.items() if name in ENERGIES}

    def _forget(self) -> None:
        if self._before is not None:
            self._unit.forget(self._before[1])
            self._before = None

    def _go_to(self, time_s: float) -> None:
        if abs(time_s - self._time_s) <= _SAME_S:
            return
        if self._before is not None and abs(time_s - self._before[0]) <= _SAME_S:
            self._time_s, state, self.found = self._before
            self._unit.restore(state)
        elif not self.has_begun or abs(time_s - self._start_s) <= _SAME_S:
            self.begin(time_s)
        else:
            raise StateError(
                f"{self.file.name} stands at {self._time_s:g} s, and {time_s:g} s is asked for;"
                " allowed: that, the start, or the interval before"
            )

    def _read(self) -> None:
        values = self._unit.get(self._names)
        found = {}
        for (what, mapped), value in zip(self.map.outputs.items(), values, strict=True):
            if not math.isfinite(value):
                raise StateError(
                    f"{self.file.name}: {mapped.name} is {value}; allowed: finite numbers"
                )
            found[what] = mapped.from_fmu(value)
        self.found = found
