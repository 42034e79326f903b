"""An entrant of the benchmark in Python: the law of `own_controller.py`, which node, C and FMU share."""

from __future__ import annotations

import iptm

TIME_GAP_S, STANDSTILL_GAP_M = 2.0, 6.0
COOL_ABOVE_DEGC, COMPRESSOR_POWER_W = 34.0, 1500.0


class Follower:
    """Follows with a constant time gap, cools with a thermostat."""

    def decide(self, measured: iptm.Measurements) -> iptm.Command:
        """Return the command of a tick."""
        state, leader = measured.state, measured.leader
        if state is None or leader is None:
            return iptm.Command(-1.0, 0.0)
        gap_m = leader.position_m - state.position_m
        gap_error_m = gap_m - STANDSTILL_GAP_M - TIME_GAP_S * state.speed_m_s
        acceleration_m_s2 = 0.1 * gap_error_m + 0.8 * (leader.speed_m_s - state.speed_m_s)
        is_warm = state.cell_n_temperature_k - 273.15 > COOL_ABOVE_DEGC
        return iptm.Command(
            min(max(acceleration_m_s2, -3.0), 2.0), COMPRESSOR_POWER_W if is_warm else 0.0
        )
