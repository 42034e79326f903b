"""Battery energy of the i3 from its measured motor torque: eq. (5) with a drag loss, and auxiliary power."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter
from studies.validation.excerpts import Trip

from iptm_core.parameters.model import PowertrainParameters
from iptm_core.physics.powertrain import drag_loss_w, traction_power_w
from iptm_core.state import FloatArray

GEAR_RATIO = 9.665
WHEEL_RADIUS_M = 0.3396
"""Tyre 155/70 R19: diameter 0.6996 m, rolling circumference 3.05 diameters."""
SPIKE_SAMPLES = 11
"""Window of the median filter against isolated spikes of the heater channel."""
STANDSTILL_SAMPLES = 5
STANDSTILL_RANGE_W = (100.0, 700.0)
"""Plausible power of electronics, lights and fans at standstill, without heater and air conditioning."""
GAP_WINDOW_S = 60
LARGEST_GAP_W = 1500.0
"""A power for a minute that no recorded consumer explains: the heater ran unrecorded."""
UNUSABLE = {
    "B02": "heater channel at 39.9 kW and a step of 22 m in height",
    "B13": "2.8 km long",
}


@dataclass(frozen=True)
class I3Drivetrain:
    """Losses of motor and inverter, and the auxiliary power that always flows.

    Attributes:
        fitted_on: names of the trips.
        motor_loss_w_per_nm2: sigma of eq. (5).
        drag_linear_w_s_rad: drag loss per motor speed.
        drag_quadratic_w_s2_rad2: drag loss per squared motor speed.
        auxiliary_power_w: power of electronics, lights and fans.
    """

    fitted_on: tuple[str, ...]
    motor_loss_w_per_nm2: float
    drag_linear_w_s_rad: float
    drag_quadratic_w_s2_rad2: float
    auxiliary_power_w: float

    def powertrain(self, driveline_efficiency: float = 1.0) -> PowertrainParameters:
        """Return the parameters of the paper's equations; zeta is not used with limits of regeneration."""
        return PowertrainParameters(
            wheel_radius_m=WHEEL_RADIUS_M,
            transmission_ratio=GEAR_RATIO,
            final_drive_ratio=1.0,
            driveline_efficiency=driveline_efficiency,
            motor_loss_w_per_nm2=self.motor_loss_w_per_nm2,
            regenerative_efficiency=0.0,
        )

    def power_w(self, speed_m_s: FloatArray, motor_torque_nm: FloatArray) -> FloatArray:
        """Return the battery power for motor and electronics, without heater and air conditioning."""
        traction = traction_power_w(speed_m_s, motor_torque_nm, self.powertrain())
        drag = drag_loss_w(
            motor_speed_rad_s(speed_m_s), self.drag_linear_w_s_rad, self.drag_quadratic_w_s2_rad2
        )
        return np.asarray(traction + drag + self.auxiliary_power_w, dtype=np.float64)


def motor_speed_rad_s(speed_m_s: FloatArray) -> FloatArray:
    """Return the motor speed at a vehicle speed."""
    return speed_m_s * (GEAR_RATIO / WHEEL_RADIUS_M)


def durations_s(trip: Trip) -> FloatArray:
    """Return how long each sample lasts; a gap in the recording counts 1.5 s at most."""
    steps = np.diff(trip.time_s, append=trip.time_s[-1] + 1.0)
    return np.clip(steps, 0.0, 1.5)


def consumers_w(trip: Trip) -> FloatArray:
    """Return the power of heater and air conditioning, the heater as far as it can be right.

    Isolated spikes are removed. Where the power at standstill contradicts the channel and agrees with a
    heater that is off, the channel is stuck and counts as off.
    """
    heating: FloatArray = median_filter(trip.heating_w, SPIKE_SAMPLES, mode="nearest")
    standing = (trip.speed_m_s < 0.1) & (np.abs(trip.motor_torque_nm) < 1.0)
    if standing.sum() >= STANDSTILL_SAMPLES:
        rest = (trip.battery_power_w - trip.cooling_w)[standing]
        low, high = STANDSTILL_RANGE_W
        agrees = low <= float(np.median(rest - heating[standing])) <= high
        if not agrees and low <= float(np.median(rest)) <= high:
            heating = np.zeros_like(heating)
    return heating + trip.cooling_w


def unexplained_power_w(trip: Trip, drivetrain: I3Drivetrain) -> float:
    """Return the largest mean power over a minute, of either sign, that nothing recorded explains."""
    known = drivetrain.power_w(trip.speed_m_s, trip.motor_torque_nm) + consumers_w(trip)
    rest = trip.battery_power_w - known
    kernel = np.full(GAP_WINDOW_S, 1.0 / GAP_WINDOW_S)
    if len(rest) < GAP_WINDOW_S:
        return 0.0
    means = np.convolve(rest, kernel, mode="valid")
    return float(means[int(np.argmax(np.abs(means)))])


def objection_to(trip: Trip, drivetrain: I3Drivetrain) -> str | None:
    """Return why the energy of a trip cannot be compared, None if it can."""
    if trip.name in UNUSABLE:
        return UNUSABLE[trip.name]
    rest_w = unexplained_power_w(trip, drivetrain)
    if abs(rest_w) > LARGEST_GAP_W:
        return f"for a minute {rest_w / 1000.0:.1f} kW flow to no recorded consumer"
    return None
