"""The file of `iptm plan`: YAML or JSON with local times; every mistake is one line.

    begin: "2026-11-30 18:00"
    time_zone: Europe/Rome
    cell: nca
    charge: 0.45
    charger_kw: 7.4
    weather: Rome
    tariff: {"00:00": 0.18, "06:00": 0.30}
    departures:
      - {at: "2026-12-01 07:00", kwh: 4.2, minutes: 31, early: [{hours: 2, probability: 0.1}]}
      - {at: "2026-12-01 17:00", kwh: 4.2, minutes: 31, charger_kw: 7.4}

Times are local ones; with an offset from UTC they are unambiguous in the hour that summer time repeats.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from datetime import datetime, timedelta, timezone
from itertools import pairwise
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np

from iptm.climate import Climate, climate_of
from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.errors import ScenarioError
from iptm_core.parameters import ModelParameters, load_parameters
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_core.state import FloatArray
from iptm_core.units import CELSIUS_ZERO_K, J_PER_KWH
from iptm_core.user_input import StrictMapping, check_known
from iptm_life.trip_map import nominal_energy_j
from iptm_plan.pack import CHILLER_W, AgingPrice, ParkedPack
from iptm_plan.schedule import STEP_S, Departure, Schedule, trip_of

HOURS = 48.0
LONGEST_H = 24.0 * 7.0
LONGEST_GAP_S = 3.0 * 3600.0
SUN_K_M2_W = 0.01
"""Air temperature that counts for a watt of sun per square metre: chosen, 8 K at noon in summer."""
_KEYS = (
    "begin", "time_zone", "hours", "car", "cell", "charge", "pack_c", "least_charge", "charger_kw",
    "departures", "weather", "climate", "tariff", "prices",
)  # fmt: skip
_CAR = ("parameter_set", "overrides", "fan", "chiller_kw")
_DEPARTURE = ("at", "kwh", "minutes", "charge", "charger_kw", "early")
_PRICES = ("battery_eur_kwh", "service_years")
_MINUTE = "%Y-%m-%d %H:%M"
_CLOCK = re.compile(r"([01]\d|2[0-3]):([0-5]\d)")


@dataclass(frozen=True, eq=False)
class Week:
    """What a file states.

    Attributes:
        begin: in UTC.
        zone: of local times.
        charge: state of charge at the beginning.
        kelvin: temperature of the pack at the beginning.
        use: settings of the ageing law, with the climate.
    """

    begin: datetime
    zone: ZoneInfo
    schedule: Schedule
    pack: ParkedPack
    price: AgingPrice
    charge: float
    kelvin: float
    use: AgingSettings

    def local(self, step: int) -> datetime:
        """Return the local time at which a step begins."""
        return (self.begin + timedelta(seconds=step * self.schedule.step_s)).astimezone(self.zone)

    def within(self, now: datetime) -> datetime:
        """Return an instant, or the beginning where it is not within the hours."""
        return now if self.begin <= now < self.local(self.schedule.steps - 1) else self.begin


def read_week(path: Path) -> Week:
    """Read a file.

    Raises:
        ScenarioError: it cannot be read, or a value is not allowed.
    """
    return week_of(read_yaml(path, ScenarioError), str(path))


def week_of(content: Any, origin: str) -> Week:
    """Return the week of the content of a file.

    Args:
        origin: what to call it in messages.

    Raises:
        IptmError: a value is not allowed.
    """
    given = StrictMapping(content, origin, _KEYS)
    given.require("begin", "time_zone", "charge", "charger_kw", "weather", "tariff")
    zone = _zone(given)
    begin = _instant(given, "begin", zone)
    length_h = _number(given, "hours", 1.0, LONGEST_H, HOURS)
    steps = round(length_h * 3600.0 / STEP_S)
    parameters, pack = _car(given)
    instants = [begin + timedelta(seconds=(step + 0.5) * STEP_S) for step in range(steps)]
    air_k = _air_k(given, zone, begin, instants)
    schedule = Schedule(
        air_k,
        _tariff(given, zone, begin, instants),
        1e3 * _number(given, "charger_kw", 0.0, 1000.0),
        _departures(given, zone, begin, parameters),
        _number(given, "least_charge", 0.0, 1.0, 0.2),
    )
    use = _use(given, schedule, parameters)
    return Week(
        begin,
        zone,
        schedule,
        pack,
        AgingPrice.of(LAWS[use.aging_law], use, parameters),
        _number(given, "charge", 0.0, 1.0),
        CELSIUS_ZERO_K + _number(given, "pack_c", -40.0, 60.0, float(air_k[0]) - CELSIUS_ZERO_K),
        use,
    )


def changed_departure(week: Week, number: int, at: datetime) -> Week:
    """Return a week in which a departure is at another time, rounded to a step.

    Args:
        number: from 1.
        at: with a time zone.

    Raises:
        ScenarioError: the departure does not exist, or the times do not fit together.
    """
    departures = list(week.schedule.departures)
    if not 1 <= number <= len(departures):
        raise ScenarioError(f"departure is {number}; allowed: 1 to {len(departures)}")
    step = _step(week.begin, at)
    departures[number - 1] = replace(departures[number - 1], step=step)
    return replace(week, schedule=replace(week.schedule, departures=tuple(departures)))


def week_from(week: Week, now: datetime) -> Week:
    """Return the rest of a week: from the step of an instant on, after a trip that is under way.

    Outside of its hours it is the week itself.
    """
    schedule = week.schedule
    step = int((week.within(now) - week.begin).total_seconds() // schedule.step_s)
    over = [each for each in schedule.departures if each.step < step]
    if over:
        step = max(step, over[-1].step + over[-1].steps(schedule.step_s))
    if not 0 < step < schedule.steps - 1:
        return week
    left = [replace(each, step=each.step - step) for each in schedule.departures[len(over) :]]
    rest = replace(
        schedule,
        air_k=schedule.air_k[step:],
        eur_kwh=schedule.eur_kwh[step:],
        charger_w=schedule.place_w(len(over)),
        departures=tuple(
            replace(each, early=tuple(one for one in each.early if one[0] <= each.step))
            for each in left
        ),
    )
    begin = week.begin + timedelta(seconds=step * schedule.step_s)
    return replace(week, begin=begin, schedule=rest)


def instant_of(text: str, zone: ZoneInfo, where: str) -> datetime:
    """Return a time in UTC: local without an offset.

    Raises:
        ScenarioError: it is not a time, or summer time leaves it out.
    """
    try:
        found = datetime.fromisoformat(text)
        if found.tzinfo is not None:
            return found.astimezone(timezone.utc)
        instant = found.replace(tzinfo=zone).astimezone(timezone.utc)
    except (ValueError, OverflowError):
        raise ScenarioError(
            f"{where} is {text!r}; allowed: a time such as '2026-12-01 07:00'"
        ) from None
    if instant.astimezone(zone).replace(tzinfo=None) != found:
        raise ScenarioError(
            f"{where} is {text!r}, which the change to summer time leaves out; allowed: other times"
        )
    return instant


def _zone(given: StrictMapping) -> ZoneInfo:
    name = given.text("time_zone")
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError):
        given.refuse("time_zone", "a name such as Europe/Rome")


def _instant(given: StrictMapping, key: str, zone: ZoneInfo) -> datetime:
    return instant_of(given.text(key), zone, f"{given.where}: {key}")


def _step(begin: datetime, at: datetime) -> int:
    return round((at - begin).total_seconds() / STEP_S)


def _number(
    given: StrictMapping, key: str, low: float, high: float, default: float | None = None
) -> float:
    if default is not None and key not in given:
        return default
    value = given.number(key)
    if not low <= value <= high:
        given.refuse(key, f"{low:g} to {high:g}")
    return value


def _car(given: StrictMapping) -> tuple[ModelParameters, ParkedPack]:
    car = given.section("car", _CAR)
    overrides = car.section("overrides")
    numbers = {key: overrides.number(key) for key in overrides}
    parameters = load_parameters(car.text("parameter_set", "paper_calibrated"), numbers).values
    has_fan = car.scalar("fan") if "fan" in car else False
    if not isinstance(has_fan, bool):
        car.refuse("fan", "true or false")
    chiller_w = 1e3 * _number(car, "chiller_kw", 0.0, 20.0, 1e-3 * CHILLER_W)
    return parameters, ParkedPack(parameters, has_fan, chiller_w)


def _departures(
    given: StrictMapping, zone: ZoneInfo, begin: datetime, parameters: ModelParameters
) -> tuple[Departure, ...]:
    found = []
    for number, entry in enumerate(given.entries("departures", may_be_empty=True)):
        each = StrictMapping(entry, f"{given.where}: departure {number + 1}", _DEPARTURE)
        each.require("at", "kwh", "minutes")
        step = _step(begin, _instant(each, "at", zone))
        if step < 0:
            each.refuse("at", f"not before {begin.astimezone(zone):{_MINUTE}}")
        trip = trip_of(each.number("kwh") * J_PER_KWH, 60.0 * each.number("minutes"), parameters)
        early = []
        for chance in each.entries("early", may_be_empty=True):
            one = StrictMapping(chance, f"{each.where}: early", ("hours", "probability"))
            hours = _number(one, "hours", 0.25, 12.0)
            early.append((round(hours * 3600.0 / STEP_S), _number(one, "probability", 0.0, 0.99)))
        asked = _number(each, "charge", 0.0, 1.0, 0.0)
        place_w = 1e3 * _number(each, "charger_kw", 0.0, 1000.0, 0.0)
        found.append(Departure(step, trip, asked, place_w, early=tuple(early)))
    return tuple(found)


def _air_k(
    given: StrictMapping, zone: ZoneInfo, begin: datetime, instants: list[datetime]
) -> FloatArray:
    weather = given.value("weather")
    if not isinstance(weather, list):
        climate = _climate(given, "weather")
        local = [at.astimezone(zone) for at in instants]
        return np.array(
            [
                climate.air_c(at.month - 1, 3600.0 * at.hour + 60.0 * at.minute) + CELSIUS_ZERO_K
                for at in local
            ]
        )
    seconds, celsius = [], []
    for number, entry in enumerate(given.entries("weather")):
        row = StrictMapping(
            entry, f"{given.where}: weather, row {number + 1}", ("at", "air_c", "sun_w_m2")
        )
        seconds.append((_instant(row, "at", zone) - begin).total_seconds())
        sun = _number(row, "sun_w_m2", 0.0, 1500.0, 0.0)
        celsius.append(_number(row, "air_c", -60.0, 60.0) + SUN_K_M2_W * sun)
    asked_s = [(at - begin).total_seconds() for at in instants]
    if any(later <= sooner for sooner, later in pairwise(seconds)):
        raise ScenarioError(
            f"{given.where}: weather is not in the order of time; allowed: later rows"
        )
    end_s = len(instants) * STEP_S
    for sooner, later in pairwise([min(seconds[0], 0.0), *seconds, max(seconds[-1], end_s)]):
        if later > 0.0 and sooner < end_s and later - sooner > LONGEST_GAP_S:
            first, last = (begin + timedelta(seconds=each) for each in (sooner, later))
            raise ScenarioError(
                f"{given.where}: weather has no row from {first.astimezone(zone):{_MINUTE}} to "
                f"{last.astimezone(zone):{_MINUTE}}; allowed: gaps of at most {LONGEST_GAP_S / 3600.0:g} h"
            )
    found: FloatArray = np.interp(asked_s, seconds, celsius) + CELSIUS_ZERO_K
    return found


def _climate(given: StrictMapping, key: str) -> Climate:
    value = given.value(key)
    if isinstance(value, bool) or not isinstance(value, (str, int, float)):
        given.refuse(key, "a climate, a temperature in degC, or rows")
    if not isinstance(value, str) and not -60.0 <= value <= 60.0:
        given.refuse(key, "-60 to 60 degC")
    return climate_of(value)


def _tariff(
    given: StrictMapping, zone: ZoneInfo, begin: datetime, instants: list[datetime]
) -> FloatArray:
    tariff = given.value("tariff")
    price: Callable[[datetime], float]
    if isinstance(tariff, list):
        rows = [
            StrictMapping(entry, f"{given.where}: tariff, row {number + 1}", ("at", "eur_kwh"))
            for number, entry in enumerate(tariff)
        ]
        starts = [_instant(row, "at", zone) for row in rows]
        prices = [_price(row, "eur_kwh") for row in rows]
        if not rows or starts[0] > begin or starts != sorted(set(starts)):
            raise ScenarioError(
                f"{given.where}: tariff does not begin with the plan or is not in the order of time; "
                f"allowed: rows from {begin.astimezone(zone):{_MINUTE}} on"
            )
        return np.array([prices[sum(start <= at for start in starts) - 1] for at in instants])
    if isinstance(tariff, Mapping):
        daily = given.section("tariff")
        clocks = sorted(daily)
        for clock in clocks:
            if not _CLOCK.fullmatch(clock):
                daily.refuse(clock, "prices from times of the day on, such as '06:00': 0.3")
        if not clocks:
            given.refuse("tariff", "at least one price")
        by_clock = {clock: _price(daily, clock) for clock in clocks}

        def price(at: datetime) -> float:
            passed = [clock for clock in clocks if clock <= f"{at.astimezone(zone):%H:%M}"]
            return by_clock[passed[-1] if passed else clocks[-1]]

    else:
        constant = _price(given, "tariff")

        def price(at: datetime) -> float:  # noqa: ARG001
            return constant

    return np.array([price(at) for at in instants])


def _price(given: StrictMapping, key: str) -> float:
    value = given.number(key)
    if not math.isfinite(value) or abs(value) > 100.0:
        given.refuse(key, "-100 to 100 EUR/kWh")
    return value


def _use(given: StrictMapping, schedule: Schedule, parameters: ModelParameters) -> AgingSettings:
    cell = given.text("cell", "nca").lower()
    check_known(cell, LAWS, given.where, "cell", ScenarioError)
    prices = given.section("prices", _PRICES)
    days = max(schedule.steps * schedule.step_s / 86400.0, 1.0)
    drawn = sum(float(each.trip.drawn[0, -1]) for each in schedule.departures) / days
    powers = [schedule.place_w(stage) for stage in range(len(schedule.departures) + 1)]
    default = AgingSettings()
    mean_k = float(np.mean(schedule.air_k))
    year: dict[str, float] = {"year_air_k": mean_k}
    if "climate" in given or isinstance(given.value("weather"), str):
        monthly_c = _climate(given, "climate" if "climate" in given else "weather").monthly_c
        year = {
            "year_air_k": float(np.mean(monthly_c)) + CELSIUS_ZERO_K,
            "year_air_swing_k": 0.5 * (max(monthly_c) - min(monthly_c)),
        }
    return AgingSettings(
        aging_law=cell,
        parking_air_k=mean_k,
        parking_air_swing_k=min(0.5 * float(np.ptp(schedule.air_k)), 30.0),
        daily_discharge=min(drawn, 1.0) or default.daily_discharge,
        charging_c_rate_1_h=max(powers) * 3600.0 / nominal_energy_j(parameters)
        or default.charging_c_rate_1_h,
        battery_eur_kwh=_number(prices, "battery_eur_kwh", 0.1, 1e5, default.battery_eur_kwh),
        service_years=_number(prices, "service_years", 0.1, 50.0, default.service_years),
        **year,
    )
