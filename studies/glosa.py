"""Green light optimal speed advisory (GLOSA): rules that keep to a speed at which the next line is open.

After K. Katsaros, R. Kernchen, M. Dianati, D. Rieck, Performance study of a Green Light Optimized Speed
Advisory (GLOSA) application using an integrated cooperative ITS simulation platform, IWCMC 2011. Where the
line ahead will be closed at the arrival, the advice is the speed that is reached there when it opens if the
present one changes evenly, ``2 d / t - v``, between a lowest speed and the limit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

import iptm
from iptm.closed_loop import TickController, decided
from iptm.driving import controller_for, trip_in_ticks
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_core.road_ahead import SpeedLimits

LOWEST_M_S = 20.0 / 3.6
"""Slower is not advised: others would not follow."""


def drive_advised(call: Mapping[str, Any], *, keeps_lines: bool = True) -> iptm.Run:
    """Drive a trip of `iptm.simulate` with the advice.

    Args:
        call: its arguments.
        keeps_lines: False for a vehicle that passes lines with its leader.
    """
    trip = iptm.Trip.of(**call)
    controller = _Advised(controller_for(trip), keeps_lines=keeps_lines)
    return decided(trip_in_ticks(trip), controller)


def advised(measured: Measurements) -> Measurements:
    """Return the measurements of a tick with the advice as the limit up to the next closed line.

    A lead vehicle that has passed the line is followed.
    """
    state, rules = measured.state, measured.rules
    if state is None or rules is None or rules.limits is None:
        return measured
    stop = next((each for each in rules.stops if each.position_m > state.position_m), None)
    if stop is None or not state.time_s < stop.until_s < np.inf:
        return measured
    if measured.leader is not None and measured.leader.position_m > stop.position_m:
        return measured
    ahead_m, passed_s = stop.position_m - state.position_m, stop.until_s - state.time_s
    advice_m_s = max(2.0 * ahead_m / passed_s - state.speed_m_s, LOWEST_M_S)
    starts = np.union1d(rules.limits.starts_m, [state.position_m, stop.position_m])
    limits = rules.limits.at_m_s(starts)
    approach = (starts >= state.position_m) & (starts < stop.position_m)
    slower = np.where(approach, np.minimum(limits, advice_m_s), limits)
    return replace(measured, road=replace(rules, limits=SpeedLimits(starts, slower)))


class _Advised:
    def __init__(self, inner: TickController, *, keeps_lines: bool) -> None:
        self._inner, self.options, self._keeps_lines = inner, inner.options, keeps_lines

    def decide(self, measured: Measurements) -> Decision:
        """Return the decision under the advice."""
        shown = advised(measured)
        if shown.road is not None and not self._keeps_lines:
            shown = replace(shown, road=replace(shown.road, stops=()))
        return self._inner.decide(shown)
