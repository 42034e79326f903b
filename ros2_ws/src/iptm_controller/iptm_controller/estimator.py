"""Noise in the measurements: noticed by their own inconsistency, and filtered.

Speeds, accelerations and positions of consecutive ticks belong together. Their residuals give the noise
level; below a threshold measurements pass unchanged, to the last bit. Above it the lead vehicle is estimated
by a Kalman filter with constant acceleration (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, section 6.2.2), the ego speed by one that is driven by the
measured acceleration, and the cell temperatures by an alpha-beta filter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from iptm_core.declaration import Settings, parameter
from iptm_core.frozen import replace
from iptm_core.parameters.model import LimitParameters
from iptm_core.state import FloatArray, LeaderState, VehicleState

FORGETTING_PER_S = 0.1
"""Share of the squared residuals of a second in their running mean."""
NOISY_SPEED_M_S = 0.02
NOISY_GAP_M = 0.3
NOISY_TEMPERATURE_K = 0.15
"""Root mean square of the residuals from which on measurements are filtered. The second one leaves room for
a real lead vehicle, whose acceleration changes between two ticks."""
LARGEST_RESIDUALS = (2.0, 3.0, 5.0)
"""Larger residuals of ego speed in m/s, gap in m and temperatures in K are single faults or another lead
vehicle, and not counted as noise."""
MOVING_M_S = 0.1
"""Residuals of the ego speed count above this speed."""
JERK_DENSITY_M2_S5 = 0.5
"""Power spectral density of the lead vehicle's jerk."""
EGO_SPEED_DRIFT_M_S = 0.02
"""Error of the ego speed that a second of measured acceleration adds, as a standard deviation."""
SMALLEST_GAP_NOISE_M, SMALLEST_SPEED_NOISE_M_S = 0.1, 0.05
GATE_SIGMAS = 5.0
"""Innovations beyond this are outliers: a vehicle that appears nearer counts at once, others a tick later."""
HARDEST_CHANGE_M_S2 = 6.0
"""A change of the lead vehicle's acceleration up to this is possible within a tick."""
MARGIN_SIGMAS = 3.0
"""The lead vehicle is taken to be nearer by this many standard deviations of gap less s_min."""
ALPHA_PER_S, BETA_PER_S = 0.2, 0.02
"""Gains of the temperature filter for a tick of 1 s."""
_SQRT_2 = math.sqrt(2.0)


@dataclass(frozen=True)
class NoiseSettings(Settings):
    """Stated noise of the measurements; the rest is estimated."""

    gap_noise_m: float = parameter(
        0.0, "standard deviation of the measured gap; 0: estimated while driving", "m", 0.0, 10.0
    )
    speed_noise_m_s: float = parameter(
        0.0, "standard deviation of measured speeds; 0: estimated while driving", "m/s", 0.0, 5.0
    )
    temperature_noise_k: float = parameter(
        0.0,
        "standard deviation of measured cell temperatures; 0: estimated while driving",
        "K",
        0.0,
        20.0,
    )


@dataclass(frozen=True)
class EstimatorMemory:
    """State carried from tick to tick; empty tuples where nothing has been measured or filtered.

    Attributes:
        residuals: of the last tick: ego speed, gap, cell temperatures; NaN for none.
        squared: running means of a third of their squared changes from tick to tick.
        lead: estimated position in m, speed in m/s and acceleration in m/s^2.
        covariance: of these, row by row.
        ego: estimated speed in m/s and its variance.
        temperatures: estimates in K and their rates in K/s, cell 1 first.
        doubted: whether the last gap was rejected as an outlier.
    """

    state: VehicleState | None = None
    leader: LeaderState | None = None
    residuals: tuple[float, ...] = (math.nan, math.nan, math.nan)
    squared: tuple[float, ...] = (0.0, 0.0, 0.0)
    lead: tuple[float, ...] = ()
    covariance: tuple[float, ...] = ()
    ego: tuple[float, ...] = ()
    temperatures: tuple[float, ...] = ()
    doubted: bool = False


class Estimator:
    """Passes perfect measurements on, filters noisy ones."""

    def __init__(self, noise: NoiseSettings, limits: LimitParameters, tick_s: float) -> None:
        """Set up an estimator that has not measured anything.

        Args:
            limits: accelerations of ordinary commands; outside them the brakes act within a tick.
        """
        self._noise = noise
        self._limits = limits
        self._tick_s = tick_s
        self._share = -math.expm1(-FORGETTING_PER_S * tick_s)
        self.memory = EstimatorMemory()

    @property
    def noise(self) -> str:
        """Which measurements are filtered and how noisy they are, empty if none is."""
        if not (self.memory.lead or self.memory.temperatures):
            return ""
        speed, gap, temperature = self._levels
        parts = []
        if self.memory.lead:
            parts.append(f"gap {gap:.1f} m, speeds {speed:.2f} m/s")
        if self.memory.temperatures:
            parts.append(f"temperatures {temperature:.1f} K")
        return ", ".join(parts)

    def update(
        self, state: VehicleState, leader: LeaderState | None
    ) -> tuple[VehicleState, LeaderState | None]:
        """Return state and lead vehicle, filtered where they are noisy."""
        memory = self.memory
        if memory.state is not None and state.time_s <= memory.state.time_s:
            memory = EstimatorMemory()
        residuals = self._residuals(memory, state, leader)
        # Noise changes from tick to tick; a constant inconsistency is something else.
        squared = [*memory.squared]
        for place, (now, before) in enumerate(zip(residuals, memory.residuals, strict=True)):
            change = now - before
            if not math.isnan(change):
                mean = squared[place]
                squared[place] = mean + self._share * (change**2 / 3.0 - mean)
        self.memory = memory = EstimatorMemory(
            state,
            leader,
            residuals,
            tuple(squared),
            memory.lead,
            memory.covariance,
            memory.ego,
            memory.temperatures,
            memory.doubted,
        )
        speed, gap, temperature = self._levels
        if temperature > 0.0:
            state = self._filter_temperatures(state)
        elif memory.temperatures:
            self.memory = replace(self.memory, temperatures=())
        if speed <= 0.0 and gap <= 0.0:
            if memory.lead or memory.ego:
                self.memory = replace(self.memory, lead=(), covariance=(), ego=())
            return state, leader
        state = self._filter_speed(state, max(speed, SMALLEST_SPEED_NOISE_M_S))
        if leader is not None:
            leader = self._filter_lead(
                leader, max(gap, SMALLEST_GAP_NOISE_M), max(speed, SMALLEST_SPEED_NOISE_M_S)
            )
        return state, leader

    @property
    def _levels(self) -> tuple[float, float, float]:
        """Standard deviations of speeds (m/s), gap (m) and temperatures (K), 0 for perfect ones."""
        speed, gap, temperature = self.memory.squared
        return (
            self._noise.speed_noise_m_s or _seen(speed, NOISY_SPEED_M_S),
            self._noise.gap_noise_m or _seen(gap, NOISY_GAP_M),
            self._noise.temperature_noise_k or _seen(temperature, NOISY_TEMPERATURE_K),
        )

    def _residuals(
        self, memory: EstimatorMemory, state: VehicleState, leader: LeaderState | None
    ) -> tuple[float, ...]:
        """Return the residuals of a tick, NaN for those that show nothing about noise."""
        last, last_leader = memory.state, memory.leader
        speed, gap, temperature = math.nan, math.nan, math.nan
        if last is None:
            return speed, gap, temperature
        passed_s = state.time_s - last.time_s
        if abs(passed_s - self._tick_s) > 0.01 * self._tick_s:
            return speed, gap, temperature
        limits = self._limits
        ordinary = state.acceleration_m_s2 >= limits.min_acceleration_m_s2 - 1e-6
        moving = min(state.speed_m_s, last.speed_m_s) > MOVING_M_S
        slower_than_top = max(state.speed_m_s, last.speed_m_s) < limits.max_speed_m_s - 0.5
        if ordinary and moving and slower_than_top:
            speed = state.speed_m_s - last.speed_m_s - state.acceleration_m_s2 * passed_s
        if leader is not None and last_leader is not None and leader.time_s > last_leader.time_s:
            driven_m = 0.5 * (leader.speed_m_s + last_leader.speed_m_s)
            driven_m *= leader.time_s - last_leader.time_s
            gap = leader.position_m - last_leader.position_m - driven_m
        temperature = 0.5 * (
            state.cell_1_temperature_k
            - last.cell_1_temperature_k
            + state.cell_n_temperature_k
            - last.cell_n_temperature_k
        )
        # The mean of two independent cells varies less than one of them.
        temperature *= _SQRT_2
        largest_speed, largest_gap, largest_temperature = LARGEST_RESIDUALS
        return (
            speed if abs(speed) < largest_speed else math.nan,
            gap if abs(gap) < largest_gap else math.nan,
            temperature if abs(temperature) < largest_temperature else math.nan,
        )

    def _filter_speed(self, state: VehicleState, noise_m_s: float) -> VehicleState:
        measured = state.speed_m_s
        if not self.memory.ego:
            self.memory = replace(self.memory, ego=(measured, noise_m_s**2))
            return state
        estimate, variance = self.memory.ego
        estimate += state.acceleration_m_s2 * self._tick_s
        variance += (EGO_SPEED_DRIFT_M_S * self._tick_s) ** 2
        gain = variance / (variance + noise_m_s**2)
        innovation = measured - estimate
        if abs(innovation) > GATE_SIGMAS * math.sqrt(variance + noise_m_s**2):
            gain = 1.0
        estimate = max(estimate + gain * innovation, 0.0)
        self.memory = replace(
            self.memory, ego=(estimate, max((1.0 - gain) * variance, 1e-6 * noise_m_s**2))
        )
        return replace(state, speed_m_s=estimate)

    def _filter_lead(self, leader: LeaderState, gap_m: float, speed_m_s: float) -> LeaderState:
        """Return the lead vehicle as estimated, nearer by a margin for the error of its position."""
        memory, dt = self.memory, self._tick_s
        measured = np.array([leader.position_m, leader.speed_m_s])
        noise = np.diag([gap_m**2, speed_m_s**2])
        fresh = np.array([leader.position_m, leader.speed_m_s, 0.0])
        fresh_covariance = np.diag([gap_m**2, speed_m_s**2, 1.0])
        doubted = False
        if not memory.lead:
            estimate, covariance = fresh, fresh_covariance
        else:
            step = np.array([[1.0, dt, 0.5 * dt * dt], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
            estimate = step @ np.array(memory.lead)
            covariance = step @ np.array(memory.covariance).reshape(3, 3) @ step.T
            covariance += JERK_DENSITY_M2_S5 * _jerk_covariance(dt)
            expected = covariance[:2, :2] + noise
            innovation = measured - estimate[:2]
            sudden = HARDEST_CHANGE_M_S2 * np.array([0.5 * dt * dt, dt])
            outside = abs(innovation) > GATE_SIGMAS * np.sqrt(np.diag(expected)) + sudden
            if outside.any() and (innovation[0] < 0.0 or memory.doubted):
                estimate, covariance = fresh, fresh_covariance
            elif outside.any():
                doubted = True
            else:
                gain = covariance[:, :2] @ np.linalg.inv(expected)
                estimate = estimate + gain @ innovation
                # Joseph's form keeps the covariance symmetric and positive.
                rest = np.eye(3)
                rest[:, :2] -= gain
                covariance = rest @ covariance @ rest.T + gain @ noise @ gain.T
        estimate[1] = max(float(estimate[1]), 0.0)
        self.memory = replace(
            memory,
            lead=tuple(estimate.tolist()),
            covariance=tuple(covariance.ravel().tolist()),
            ego=self.memory.ego,
            doubted=doubted,
        )
        margin_m = MARGIN_SIGMAS * self._distance_deviation_m(covariance)
        return LeaderState(leader.time_s, float(estimate[0]) - margin_m, float(estimate[1]))

    def _distance_deviation_m(self, covariance: FloatArray) -> float:
        """Return the standard deviation of gap less s_min, which errors of both speeds shift as well."""
        speed, variance = self.memory.ego
        limits = self._limits
        per_speed_s = speed / (
            2.0 * math.sqrt(-limits.min_acceleration_m_s2 * limits.max_acceleration_m_s2)
        )
        of_lead = np.array([1.0, per_speed_s])
        return math.sqrt(float(of_lead @ covariance[:2, :2] @ of_lead) + per_speed_s**2 * variance)

    def _filter_temperatures(self, state: VehicleState) -> VehicleState:
        measured = (state.cell_1_temperature_k, state.cell_n_temperature_k)
        known = self.memory.temperatures or (*measured, 0.0, 0.0)
        alpha = -math.expm1(-ALPHA_PER_S * self._tick_s)
        beta = -math.expm1(-BETA_PER_S * self._tick_s)
        estimates, rates = [], []
        for value, estimate, rate in zip(measured, known[:2], known[2:], strict=True):
            expected = estimate + rate * self._tick_s
            estimates.append(expected + alpha * (value - expected))
            rates.append(rate + beta / self._tick_s * (value - expected))
        self.memory = replace(self.memory, temperatures=(*estimates, *rates))
        return replace(state, cell_1_temperature_k=estimates[0], cell_n_temperature_k=estimates[1])


def _seen(squared: float, floor: float) -> float:
    """Return the standard deviation of a measurement by the squared changes of its residuals."""
    # A residual is the difference of two measurements, and its change has three times its variance.
    return math.sqrt(0.5 * squared) if squared > floor * floor else 0.0


def _jerk_covariance(dt: float) -> FloatArray:
    """Return the covariance that white jerk of unit density adds in a time, shape (3, 3)."""
    covariance: FloatArray = np.array(
        [
            [dt**5 / 20.0, dt**4 / 8.0, dt**3 / 6.0],
            [dt**4 / 8.0, dt**3 / 3.0, dt**2 / 2.0],
            [dt**3 / 6.0, dt**2 / 2.0, dt],
        ]
    )
    return covariance
