"""How long runs are going to take, judged by their size and by what earlier runs took."""

from __future__ import annotations

from collections import defaultdict

from iptm_controller.horizon import Horizon
from iptm_studies.run_inputs import RunInputs
from iptm_studies.run_spec import RunKind, RunSpec

# Rough figures of one core; what earlier runs took corrects them.
_PER_TICK_S = 0.6e-3
_PER_TICK_AND_STEP_S = 0.17e-3
_PER_TICK_AND_SECOND_AHEAD_S = 0.006e-3
_WHOLE_TRIP_PER_TICK_S = 20e-3
_SETUP_S = 1.0


class ExpectedTimes:
    """A rough model of wall times that learns a factor per kind of run."""

    def __init__(self) -> None:
        self._taken: defaultdict[RunKind, float] = defaultdict(float)
        self._modelled: defaultdict[RunKind, float] = defaultdict(float)

    def learn(self, spec: RunSpec, ticks: int, taken_s: float) -> None:
        """Take into account what a run of so many ticks took."""
        self._taken[spec.kind] += taken_s
        self._modelled[spec.kind] += modelled_s(spec, ticks)

    def of(self, inputs: RunInputs) -> float:
        """Return the expected wall time of a run in seconds."""
        kind = inputs.spec.kind
        factor = self._taken[kind] / self._modelled[kind] if self._modelled[kind] > 0.0 else 1.0
        return factor * modelled_s(inputs.spec, inputs.ticks)


def modelled_s(spec: RunSpec, ticks: int) -> float:
    """Return the wall time of a run by its size alone, in seconds."""
    horizon = Horizon.parse(spec.horizon)
    per_tick = (
        _PER_TICK_S
        + _PER_TICK_AND_STEP_S * horizon.steps
        + _PER_TICK_AND_SECOND_AHEAD_S * horizon.duration_s
    )
    if spec.kind is RunKind.WHOLE_TRIP:
        per_tick += _WHOLE_TRIP_PER_TICK_S
    return _SETUP_S + ticks * per_tick


def clock_text(seconds: float) -> str:
    """Return seconds as ``45 s``, ``3:20 min`` or ``1:05 h``."""
    whole = round(seconds)
    if whole < 90:
        return f"{whole} s"
    minutes, rest = divmod(whole, 60)
    if minutes < 90:
        return f"{minutes}:{rest:02d} min"
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d} h"
