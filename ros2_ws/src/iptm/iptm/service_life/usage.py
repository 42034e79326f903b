"""Patterns of use and habits of charging."""

from __future__ import annotations

from dataclasses import dataclass, replace

CITY, MOTORWAY = "wltc_class3b", "hwfet"


@dataclass(frozen=True)
class Usage:
    """Equal driving days, and days of rest between them; the pack is charged after the last trip of a day.

    Attributes:
        name: for tables.
        about: in words.
        cycle: driving cycle of every trip, where no other is given.
        departures: hour of the day and number of trips in a row, for each drive of a day.
        days_a_week: driving days.
        charging_c_rate_1_h: power of the charger at night over the nominal energy of the pack.
        target: state of charge at the first departure.
        managed_target: the same with charging managed.
        fast_target: state of charge up to which a fast charger is used between drives; 0 for none.
        just_in_time: the charging ends at the first departure instead of beginning on arrival.
        free_cooling: a radiator and its fan cool the parked pack where it is warmer than the air.
    """

    name: str
    about: str
    cycle: str
    departures: tuple[tuple[float, int], ...]
    days_a_week: float
    charging_c_rate_1_h: float
    target: float
    managed_target: float
    fast_target: float = 0.0
    just_in_time: bool = False
    free_cooling: bool = False

    def managed(self) -> Usage:
        """Return the same use with charging managed and the parked pack cooled by the air."""
        return replace(self, target=self.managed_target, just_in_time=True, free_cooling=True)


FAST_C_RATE_1_H = 1.0
USAGES = (
    Usage(
        "commuter",
        "one WLTC at 7 and at 17 h on five days a week, 7 kW at home to 80 %; managed: to 60 %, just in time",
        CITY,
        ((7.0, 1), (17.0, 1)),
        days_a_week=5.0,
        charging_c_rate_1_h=0.1,
        target=0.8,
        managed_target=0.6,
    ),
    Usage(
        "taxi",
        "four WLTC from 6 and from 13 h on six days a week, 11 kW to 90 %; managed: to 80 %, just in time",
        CITY,
        ((6.0, 4), (13.0, 4)),
        days_a_week=6.0,
        charging_c_rate_1_h=0.15,
        target=0.9,
        managed_target=0.8,
    ),
    Usage(
        "long distance",
        "ten HWFET from 8 and eight from 12 h on five days a week, between them a fast charger at 1C to "
        "80 %, 11 kW at night to 90 %; managed: to 80 %, just in time",
        MOTORWAY,
        ((8.0, 10), (12.0, 8)),
        days_a_week=5.0,
        charging_c_rate_1_h=0.15,
        target=0.9,
        managed_target=0.8,
        fast_target=0.8,
    ),
)
