"""What stated brakes can do, computed apart from plant, monitor and controller.

Many ego vehicles at once brake as hard as they can a reaction time after the lead vehicle began to, in small
steps of time. For a vehicle in a drive, whose lead vehicle moves as it did, see `iptm.bounds`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from iptm_core.parameters.model import BrakeParameters
from iptm_core.state import FloatArray

STEP_S = 0.01
LONGEST_S = 60.0

LeadPositions = Callable[[float], FloatArray]
"""From the time in s since the beginning to positions of the lead vehicles, shape (n,)."""


def emergency_stops(
    lead_m: LeadPositions,
    positions_m: FloatArray,
    speeds_m_s: FloatArray,
    accelerations_m_s2: FloatArray,
    brakes: BrakeParameters,
    reaction_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Return smallest gap and speed of impact of ego vehicles that brake as hard as they can.

    Args:
        lead_m: rear bumpers of the lead vehicles.
        positions_m: front bumpers of the ego vehicles at the beginning, shape (n,), as all arrays.
        speeds_m_s: of the ego vehicles.
        accelerations_m_s2: theirs, which last until they brake.
        brakes: of the ego vehicles.
        reaction_s: time from the deceleration of the lead vehicle to the request to the brakes (sampling of
            the sensor).

    Returns:
        Smallest gaps in m up to standstill, negative for an overlap; speed differences in m/s when the gap
        closes, 0 where it does not. Shapes (n,).
    """
    position, speed = positions_m.astype(float), speeds_m_s.astype(float)
    acceleration = accelerations_m_s2.astype(float)
    lead = lead_m(0.0)
    gap = lead - position
    smallest, impact = gap.copy(), np.zeros(gap.shape)
    for step in range(1, round(LONGEST_S / STEP_S) + 1):
        if (step - 1) * STEP_S >= reaction_s + brakes.delay_s - 1e-9:
            acceleration = np.maximum(
                acceleration - brakes.build_up_m_s3 * STEP_S, -brakes.max_deceleration_m_s2
            )
        ahead = np.maximum(speed + acceleration * STEP_S, 0.0)
        position = position + 0.5 * (speed + ahead) * STEP_S
        lead_ahead = lead_m(step * STEP_S)
        gap_ahead = lead_ahead - position
        touched = (gap > 0.0) & (gap_ahead <= 0.0)
        impact[touched] = np.maximum(ahead - (lead_ahead - lead) / STEP_S, 0.0)[touched]
        gap, speed, lead = gap_ahead, ahead, lead_ahead
        np.minimum(smallest, gap, out=smallest)
        if not speed.any():
            break
    return smallest, impact


def braking_leads(
    positions_m: FloatArray, speeds_m_s: FloatArray, decelerations_m_s2: FloatArray
) -> LeadPositions:
    """Return lead vehicles that brake to a standstill from now on; arrays of shape (n,)."""
    halts_s = speeds_m_s / decelerations_m_s2

    def lead_m(elapsed_s: float) -> FloatArray:
        moving_s = np.minimum(elapsed_s, halts_s)
        moved_m: FloatArray = moving_s * (speeds_m_s - 0.5 * decelerations_m_s2 * moving_s)
        return positions_m + moved_m

    return lead_m
