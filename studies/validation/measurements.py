"""Measured trips, drives and tests as frozen data, in SI units."""

from __future__ import annotations

from dataclasses import dataclass, field

import pandas as pd

from iptm.parts import FloatArray, TextEnum


class Driver(TextEnum):
    """Who controls the speed in a recorded drive."""

    ADAPTIVE_CRUISE_CONTROL = "adaptive_cruise_control"
    PROVING_GROUND = "proving_ground"
    ROAD = "road"


@dataclass(frozen=True, eq=False)
class Trip:
    """A trip of the BMW i3 at about 1 Hz; all arrays have shape (n,), missing values are NaN.

    Attributes:
        name: ``A..`` for a summer trip, ``B..`` for a winter trip.
        time_s: time since the start of the recording.
        speed_m_s: vehicle speed.
        elevation_m: height above sea level.
        motor_torque_nm: motor torque, negative when braking.
        voltage_v: battery voltage.
        current_a: battery current, positive when discharging.
        battery_temperature_k: pack temperature, in steps of a kelvin.
        charge: state of charge, 0 to 1.
        heating_w: electric power of the cabin heater as recorded, which is wrong in some trips.
        cooling_w: electric power of the air conditioning.
        ambient_k: temperature of the air outside.
        heat_exchanger_k: temperature of the cabin heat exchanger.
    """

    name: str
    time_s: FloatArray
    speed_m_s: FloatArray
    elevation_m: FloatArray
    motor_torque_nm: FloatArray
    voltage_v: FloatArray
    current_a: FloatArray
    battery_temperature_k: FloatArray
    charge: FloatArray
    heating_w: FloatArray
    cooling_w: FloatArray
    ambient_k: FloatArray
    heat_exchanger_k: FloatArray

    @property
    def is_winter(self) -> bool:
        """True for the winter trips."""
        return self.name.startswith("B")

    @property
    def battery_power_w(self) -> FloatArray:
        """Power at the battery terminals, positive when discharging."""
        return self.voltage_v * self.current_a


@dataclass(frozen=True, eq=False)
class Drive:
    """Speed of one vehicle at equal steps.

    Attributes:
        name: unique name.
        run: recording it belongs to; vehicles of one platoon share it.
        driver: who controls the speed.
        step_s: sampling interval.
        speed_m_s: speeds, shape (n,), NaN where nothing was recorded.
        leader_speed_m_s: speeds of the vehicle ahead, shape (n,); None without one.
        gap_m: gap between both from bumper to bumper, shape (n,), NaN where it is not known.
    """

    name: str
    run: str
    driver: Driver
    step_s: float
    speed_m_s: FloatArray
    leader_speed_m_s: FloatArray | None = None
    gap_m: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class CellTest:
    """A test of one cell; all arrays have shape (n,).

    Attributes:
        name: for example ``25degC_US06``.
        chamber_k: temperature of the chamber.
        time_s: time, increasing, from the first current on.
        current_a: current, positive when discharging.
        mean_current_a: mean current since the previous sample.
        voltage_v: terminal voltage.
        discharged_ah: charge drawn since the cell was full.
        case_temperature_k: temperature of the case.
    """

    name: str
    chamber_k: float
    time_s: FloatArray
    current_a: FloatArray
    mean_current_a: FloatArray
    voltage_v: FloatArray
    discharged_ah: FloatArray
    case_temperature_k: FloatArray

    @property
    def is_fitted(self) -> bool:
        """True for the tests that the cell is fitted to: US06 and pulses."""
        return "US06" in self.name.upper() or self.is_pulse_test

    @property
    def is_pulse_test(self) -> bool:
        """True for a hybrid pulse power characterisation."""
        return "HPPC" in self.name.upper()


@dataclass(frozen=True, eq=False)
class MeasuredData:
    """Everything found in the folders that were read; parts may be empty.

    Attributes:
        dynamometer_tests: consumption of cars on cycles of the dynamometer, a row per test: unique name of
            ``car`` and configuration, ``make`` (spelt in one way), ``cycle`` (``udds`` or ``hwfet``),
            ``mass_kg`` (equivalent test weight), road load coefficients ``constant_n``, ``linear_n_s_m`` and
            ``quadratic_n_s2_m2``, and ``consumption_wh_km`` (energy from the grid per distance).
    """

    trips: tuple[Trip, ...] = ()
    drives: tuple[Drive, ...] = ()
    cell_tests: tuple[CellTest, ...] = ()
    dynamometer_tests: pd.DataFrame = field(default_factory=pd.DataFrame)
