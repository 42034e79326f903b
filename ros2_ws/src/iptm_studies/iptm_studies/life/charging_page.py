"""The page about trips to a fast charger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from iptm_core.aging_laws.cells import AGING_CELLS
from iptm_core.aging_laws.law import Mechanism
from iptm_core.charging_stop import (
    LIMIT_1_H,
    LIMIT_C,
    TAPER_CHARGE,
    TAPER_SHARE,
    ChargingStopSettings,
)
from iptm_core.markdown import markdown_table
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_studies.life.charging_stop import (
    EVENING_LAW,
    HEATER_W,
    MINUTE_KWH,
    RADIATOR,
    WORTHS_AIR_C,
    Arrival,
    Evening,
    Preparation,
    charging_damage,
)

CHARGING_PAGE = "charging-stop.md"
_NOTICE = "<!-- Made by scripts/life --charging-stop; do not edit. -->"
_LIMITS = """\
- The limits of the current are assumed, not measured; minutes in the cold depend on them most of all.
- "Own heat" is a car that leaves its heater off at the charger, where a warm arrival is worth most. A
  car that heats there as well (the other columns, with the energy that its heater takes from the
  charger) gains much less from heating on the way.
- The loss of the pack warms it while charging. For tesla_model_3 the paper's entropic coefficient takes
  most of that away again, so that a cold pack hardly warms up. The upper temperature limit is held by
  the chiller, whatever heat that is.
- Lithium plating is in none of the laws. It is what limits charging in the cold, and the ageing column
  does not show what a warm arrival saves of it.
- Ageing at the charger is not weighed by the controller; the capacity that a kelvin costs while parked
  is, where the law is that of a cell."""
_ABOUT = """\
A WLTC that begins with the pack as cold as the air and ends at a fast charger of {power:g} kW, which
charges from {start:g} to {end:g} %. The cells take at most, in 1/h (assumed): {limits}; of that, over
the state of charge, {taper}. Cars: the paper's pack with 350 kJ/K, 0.05 ohm and 25 W/K to the air
(chosen), and tesla_model_3 as shipped, with three times the heat capacity. The heater has {heater:g}
kW.

- **none**: no heater on the way.
- **last 20 minutes**: full heater power in the last 20 minutes, up to {warm:g} °C.
- **optimised**: the default strategy with `charging_minute_kwh={worth:g}`: a minute is worth {worth:g}
  kWh."""
_TABLE = """\
Minutes at the charger, and how many are saved against no preparation. The energy is that from the pack
on the way, beyond that without preparation."""
_WORTH = """\
The first car at {air:g} °C: the more a minute is worth, the longer the pack is heated."""
_AGEING = """\
Cyclic damage of one charge after the optimised trip, by the laws of cells that have a cyclic part,
relative to the charge after a trip without preparation (below 1: less ageing). (T), (C): temperatures
or currents lie outside of the experiments behind the law. All relative numbers with these marks are
extrapolations."""
_FREE = """\
A WLTC with a warm pack in cooler air, the first car under the law of {law} with the hours after the
trip, without and with a radiator of {conductance:g} W/K at a scale of {fan:g} W for pump and fan
(chosen)."""


def charging_page(
    command: str,
    arrivals: Sequence[Arrival],
    worths: Sequence[tuple[float, Arrival]],
    evenings: Sequence[Evening],
) -> str:
    """Return the page as Markdown.

    Args:
        command: what makes it.
        arrivals: trips with every preparation.
        worths: trips with minutes of different worth in kWh.
        evenings: trips from warm packs.
    """
    stop = ChargingStopSettings()
    limits = ", ".join(
        f"{rate:g} at {celsius:g} °C" for celsius, rate in zip(LIMIT_C, LIMIT_1_H, strict=True)
    )
    taper = ", ".join(
        f"{100 * share:g} % at {100 * charge:g} %"
        for charge, share in zip(TAPER_CHARGE, TAPER_SHARE, strict=True)
    )
    about = _ABOUT.format(
        power=stop.charging_power_kw,
        start=100 * stop.fast_charge_from,
        end=100 * stop.fast_charge_to,
        limits=limits,
        taper=taper,
        heater=1e-3 * HEATER_W,
        warm=LIMIT_C[-1],
        worth=MINUTE_KWH,
    )
    conductance, fan = RADIATOR.values()
    parts = [
        _NOTICE,
        "# To a fast charger with a warm pack",
        about,
        f"Command: `{command}`.",
        "## Minutes saved and energy spent",
        _TABLE,
        *(_table(car, arrivals) for car in dict.fromkeys(each.car for each in arrivals)),
        "## What a minute is worth",
        _WORTH.format(air=WORTHS_AIR_C),
        _worths(arrivals, worths),
        "## Ageing at the charger",
        _AGEING,
        _ageing(arrivals),
        "## Free cooling",
        _FREE.format(law=EVENING_LAW, conductance=conductance, fan=fan),
        _evenings(evenings),
        "## Limits",
        _LIMITS,
    ]
    return "\n\n".join(parts) + "\n"


def _bases(arrivals: Sequence[Arrival]) -> Mapping[tuple[str, float], Arrival]:
    return {
        (each.car, each.air_c): each for each in arrivals if each.preparation is Preparation.NONE
    }


def _minutes(each: Arrival) -> tuple[float, float]:
    return float(each.charge.minutes[0]), float(each.heated.minutes[0])


def _table(car: str, arrivals: Sequence[Arrival]) -> str:
    bases = _bases(arrivals)
    rows = []
    for each in arrivals:
        if each.car != car:
            continue
        base = bases[car, each.air_c]
        (own, heated), (own_base, heated_base) = _minutes(each), _minutes(base)
        rows.append(
            [
                f"{each.air_c:g}",
                str(each.preparation),
                f"{each.arrival_c:.1f}",
                f"{each.battery_kwh - base.battery_kwh:.2f}",
                f"{own:.1f}",
                f"{own_base - own:.1f}",
                f"{heated:.1f}",
                f"{heated_base - heated:.1f}",
                f"{each.heated.heater_j[0] / 3.6e6:.2f}",
            ]
        )
    heads = (
        "air, °C:",
        "on the way",
        "arrives, °C:",
        "energy, kWh:",
        "own heat, min:",
        "saved:",
        "heater on, min:",
        "saved:",
        "kWh there:",
    )
    return f"**{car}**\n\n" + markdown_table(heads, rows)


def _worths(arrivals: Sequence[Arrival], worths: Sequence[tuple[float, Arrival]]) -> str:
    bases = _bases(arrivals)
    rows = []
    for minute_kwh, each in worths:
        base = bases[each.car, each.air_c]
        rows.append(
            [
                f"{minute_kwh:g}",
                f"{each.arrival_c:.1f}",
                f"{each.battery_kwh - base.battery_kwh:.2f}",
                f"{_minutes(base)[0] - _minutes(each)[0]:.1f}",
            ]
        )
    return markdown_table(("kWh a minute:", "arrives, °C:", "energy, kWh:", "saved, min:"), rows)


def _ageing(arrivals: Sequence[Arrival]) -> str:
    bases = _bases(arrivals)
    cells = {
        name: cell
        for name, cell in AGING_CELLS.items()
        if any(part.mechanism is Mechanism.CYCLIC for part in cell.law.mechanisms)
    }
    rows = []
    for each in arrivals:
        if each.preparation is not Preparation.OPTIMISED:
            continue
        base = bases[each.car, each.air_c]
        celsius = each.charge.temperature_k - CELSIUS_ZERO_K
        row = [each.car, f"{each.air_c:g}"]
        for cell in cells.values():
            before = charging_damage(cell, base.charge)
            ratio = charging_damage(cell, each.charge) / before if before > 0.0 else np.nan
            tests = cell.experiments
            is_outside = celsius.min() < tests.cycling_c[0] or celsius.max() > tests.cycling_c[1]
            marks = " (T)" if is_outside else ""
            if each.charge.c_rate_1_h.max() > tests.largest_c_rate_1_h:
                marks += " (C)"
            row.append(f"{ratio:.2f}{marks}" if np.isfinite(ratio) else "-")
        rows.append(row)
    return markdown_table(("car", "air, °C:", *(f"{name}:" for name in cells)), rows)


def _evenings(evenings: Sequence[Evening]) -> str:
    rows = [
        [
            each.place,
            each.cooling,
            f"{each.arrival_c:.1f}",
            f"{each.thermal_kwh:.3f}",
            f"{each.removed_kwh:.3f}",
            f"{each.removed_kwh / each.thermal_kwh:.1f}" if each.thermal_kwh > 1e-4 else "-",
        ]
        for each in evenings
    ]
    heads = (
        "evening",
        "cooled by",
        "arrives, °C:",
        "energy, kWh:",
        "heat removed, kWh:",
        "heat per energy:",
    )
    return markdown_table(heads, rows)
