"""Cost of the temperature of a parked pack, in capacity at the end of its service.

A parked pack approaches a temperature T_p with a time constant tau. A kelvin more on arrival decays like
``exp(-t / tau)``, and as the damage u of a mechanism adds up (see ``law``), what it costs is a secant:

    w(T) = sum over mechanisms of tau p u_f^(p-1) (r(T) - r(T_p)) / (T - T_p)

with the rate r of the damage and the damage u_f at the end of service, where the loss counts. T_p is the
mean of the air over a day and what trips add to it; the swing of the air between day and night, which the
pack follows damped, is averaged over. A kelvin that is left when the next trip begins costs there what it
costs here, so the time has no end by default.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.law import AgingLaw, Load, Mechanism, MechanismLaw
from iptm_core.declaration import Settings, parameter
from iptm_core.parameters.model import ModelParameters
from iptm_core.physics.ops import Scalar
from iptm_core.state import FloatArray
from iptm_core.units import SECONDS_PER_DAY, SECONDS_PER_HOUR

PAPER_LAW = "paper"
PRICED_LAW = LAWS["nca"]
"""Law of costs in one currency where none of a cell is stated: the paper's has no ageing at rest."""
FROM_SET = 0.0
DAYS_PER_YEAR = 365.25
END_OF_LIFE_LOSS = 0.2
"""A pack is replaced at 80 % of its capacity: its price is spread over this loss."""
_HOURS_PER_DAY = 24.0
_WH_PER_KWH = 1000.0
_ANGLES = 2.0 * np.pi * np.arange(24) / 24.0
_SMALLEST_STEP_K = 0.05


@dataclass(frozen=True)
class AgingSettings(Settings):
    """Ageing in the cost of the controller, and how the car is used between trips.

    All but the law count only with the law of a cell: the paper's law has no ageing at rest.
    """

    aging_law: str = parameter(
        PAPER_LAW,
        "ageing law of the controller's cost; with one of a cell the hours after the trip count, and the "
        "energy of the compressor has its price",
        choices=(PAPER_LAW, *LAWS),
    )
    parking_air_k: float = parameter(
        FROM_SET, "mean of the air over a day, 0 takes the ambient of the model", "K", 0.0, 333.15
    )
    parking_air_swing_k: float = parameter(
        5.0, "half of the range of the air over a day", "K", 0.0, 30.0
    )
    year_air_k: float = parameter(
        FROM_SET, "mean air temperature over a year; 0 takes the mean of the day", "K", 0.0, 333.15
    )
    year_air_swing_k: float = parameter(
        0.0, "half of the range of the monthly means of the air", "K", 0.0, 40.0
    )
    pack_above_air_k: float = parameter(
        3.0, "temperature of the pack above the air, mean over days of use", "K", 0.0, 40.0
    )
    parked_time_constant_h: float = parameter(
        10.0, "time constant of a parked pack towards the air", "h", 0.1, 100.0
    )
    parked_h: float = parameter(
        0.0,
        "hours after the trip that count, 0 for all until the pack has the air's",
        "h",
        0.0,
        1e4,
    )
    charging_target: float = parameter(
        0.8, "state of charge to which the pack is charged", "", 0.0, 1.0
    )
    charging_c_rate_1_h: float = parameter(
        0.1, "power of the charger over the nominal energy of the pack", "1/h", 0.0, 10.0
    )
    daily_discharge: float = parameter(
        0.1, "share of the capacity that a day's trips take", "", 0.0, 2.0
    )
    service_years: float = parameter(8.0, "years of service", "", 0.1, 50.0)
    electricity_eur_kwh: float = parameter(
        0.25, "price of a kilowatt-hour of electricity", "EUR/kWh", 0.0, 100.0
    )
    battery_eur_kwh: float = parameter(
        130.0, "price of a kilowatt-hour of battery", "EUR/kWh", 0.1, 1e5
    )
    headway_eur_m2_h: float = parameter(
        0.0025,
        "price of an hour at a metre, squared, from the desired gap, in strategies that price all",
        "EUR/(h m^2)",
        0.0,
        100.0,
    )

    @property
    def parked_charge(self) -> float:
        """Mean state of charge on arrival days: half of the trips come before the charging."""
        return max(self.charging_target - 0.25 * self.daily_discharge, 0.0)

    def law(self) -> AgingLaw | None:
        """Return the law of a cell, None for the paper's."""
        return LAWS.get(self.aging_law)


class ParkedAging:
    """Capacity at the end of service as a function of the temperature of the pack, for a law and a use.

    Attributes:
        weights: change of the capacity loss at the end of service over that of the damage, ``p u_f^(p-1)``,
            one for each mechanism.
        parked_k: temperature that a parked pack approaches, mean of a day.
    """

    def __init__(self, law: AgingLaw, use: AgingSettings, ambient_k: float) -> None:
        """Work out the damage at the end of service."""
        self._law, self._use = law, use
        day_air_k = use.parking_air_k or ambient_k
        self.parked_k = day_air_k + use.pack_above_air_k
        self._tau_s = use.parked_time_constant_h * SECONDS_PER_HOUR
        damping = math.hypot(1.0, 2.0 * math.pi * self._tau_s / SECONDS_PER_DAY)
        self._swing_k: FloatArray = use.parking_air_swing_k / damping * np.cos(_ANGLES)
        left = math.exp(-use.parked_h * SECONDS_PER_HOUR / self._tau_s) if use.parked_h else 0.0
        self._left = left
        year_k = (use.year_air_k or day_air_k) + use.pack_above_air_k
        seasons_k = year_k + use.year_air_swing_k * np.cos(_ANGLES)
        service_s = use.service_years * DAYS_PER_YEAR * SECONDS_PER_DAY
        self.weights = tuple(
            _marginal_loss(part, service_s * float(np.mean(self._rates(part, seasons_k))))
            for part in law.mechanisms
        )

    def kelvin_price_1_k(self, temperature_k: FloatArray) -> FloatArray:
        """Return what a kelvin more costs on arrival, as a share of nominal capacity, shape (n,)."""
        above_k = temperature_k - self.parked_k
        above_k = np.where(np.abs(above_k) < _SMALLEST_STEP_K, _SMALLEST_STEP_K, above_k)
        total = np.zeros_like(above_k)
        for part, weight in zip(self._law.mechanisms, self.weights, strict=True):
            arrival, end = (
                np.mean(self._rates(part, self.parked_k + left * above_k), axis=1)
                for left in (1.0, self._left)
            )
            total += weight * (arrival - end) / above_k
        return self._tau_s * total

    def loss_1_s(
        self, temperature_k: FloatArray, c_rate_1_h: FloatArray, charge: FloatArray
    ) -> FloatArray:
        """Return the loss rate of all mechanisms, of cycles as deep as a day's use, shape (n,)."""
        day = self._day(temperature_k, np.abs(c_rate_1_h))
        load = replace(day, charge=charge)
        total = np.zeros_like(temperature_k)
        for part, weight in zip(self._law.mechanisms, self.weights, strict=True):
            total += weight * part.damage_rate_1_s(load)
        return total

    def calendar_1_s(self, temperature_k: float, charge: float) -> tuple[float, float, float]:
        """Return the calendar loss rate, its slope and curvature over temperature; charge NaN: parked."""
        if math.isnan(charge):
            charge = self._use.parked_charge
        rate = slope = curvature = 0.0
        for part, weight in zip(self._law.mechanisms, self.weights, strict=True):
            if part.mechanism is Mechanism.CALENDAR:
                below, at, above = (
                    Load(temperature_k + step_k, 0.0, charge) for step_k in (-0.5, 0.0, 0.5)
                )
                rate += weight * part.damage_rate_1_s(at)
                slope += weight * part.damage_slope_1_s_k(at)
                curvature += weight * (
                    part.damage_slope_1_s_k(above) - part.damage_slope_1_s_k(below)
                )
        return rate, slope, curvature

    def cyclic_1_s(self, temperature_k: float) -> tuple[float, float]:
        """Return the cyclic loss at 1C and its slope over temperature, of cycles as deep as a day's use."""
        rate = slope = 0.0
        for part, weight in zip(self._law.mechanisms, self.weights, strict=True):
            if part.mechanism is Mechanism.CYCLIC:
                load = self._day(temperature_k, 1.0)
                rate += weight * float(part.damage_rate_1_s(load))
                slope += weight * float(part.damage_slope_1_s_k(load))
        return rate, slope

    def _day(self, temperature_k: Scalar, c_rate_1_h: Scalar) -> Load:
        use = self._use
        mean_1_h = 2.0 * use.daily_discharge / _HOURS_PER_DAY
        return Load(
            temperature_k,
            c_rate_1_h,
            use.parked_charge,
            min(use.daily_discharge, 1.0),
            mean_1_h,
            use.charging_c_rate_1_h,
        )

    def _rates(self, part: MechanismLaw, mean_k: FloatArray) -> FloatArray:
        """Return rates of damage over the hours of a day (axis 1) at mean temperatures (axis 0)."""
        kelvin = mean_k[:, np.newaxis] + self._swing_k
        mean_1_h = 2.0 * self._use.daily_discharge / _HOURS_PER_DAY
        rates: FloatArray = np.broadcast_to(
            part.damage_rate_1_s(self._day(kelvin, mean_1_h)), kelvin.shape
        )
        return rates


def capacity_price_eur(use: AgingSettings, model: ModelParameters) -> float:
    """Return the price of the whole capacity of a pack, in EUR."""
    pack = model.pack
    pack_wh = pack.open_circuit_voltage_v * model.cell.nominal_capacity_ah * pack.parallel
    return use.battery_eur_kwh * pack_wh / _WH_PER_KWH / END_OF_LIFE_LOSS


def _marginal_loss(part: MechanismLaw, damage: float) -> float:
    return part.exponent * damage ** (part.exponent - 1.0) if damage > 0.0 else 0.0
