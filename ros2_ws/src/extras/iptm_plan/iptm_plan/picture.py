"""Picture of a plan: state of charge, temperature, power, tariff, and prices at departures and arrivals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from iptm.panels import BLUE, GREEN, GREY, ORANGE, PURPLE, RED
from iptm.picture import STYLE
from iptm_core.units import CELSIUS_ZERO_K
from iptm_plan.course import Course
from iptm_plan.day_plan import DayPlan
from iptm_plan.week_file import Week


def draw(week: Week, plan: DayPlan, course: Course, rule: tuple[str, Course], path: Path) -> None:
    """Draw a plan, beside a rule.

    Raises:
        OSError: the file cannot be written.
    """
    schedule = week.schedule
    ends = [week.local(step).replace(tzinfo=None) for step in range(schedule.steps + 1)]
    kilowatts = np.append(course.grid_j, 0.0) / schedule.step_s / 1e3
    thermal = np.array([0.0 if each is None else each.thermal_w for each in course.decisions])
    thermal = np.append(thermal, 0.0) / 1e3
    name, ruled = rule
    with rc_context(STYLE):
        figure = Figure(figsize=(12.0, 9.5), layout="constrained")
        FigureCanvasAgg(figure)
        charge, warmth, power, price = figure.subplots(4, 1, sharex=True)
        charge.plot(ends, 100.0 * course.charge, color=BLUE, label="plan")
        charge.plot(ends, 100.0 * ruled.charge, color=GREY, ls="--", label=name)
        charge.axhline(100.0 * schedule.least_charge, color=RED, lw=0.8, ls=":")
        charge.set(ylabel="%", title="state of charge")
        air = np.append(schedule.air_k, schedule.air_k[-1]) - CELSIUS_ZERO_K
        warmth.plot(ends, course.kelvin - CELSIUS_ZERO_K, color=BLUE, label="pack, plan")
        warmth.plot(ends, ruled.kelvin - CELSIUS_ZERO_K, color=GREY, ls="--", label=f"pack, {name}")
        warmth.plot(ends, air, color=ORANGE, lw=0.8, label="air")
        warmth.set(ylabel="°C", title="temperature")
        power.fill_between(
            ends, 0.0, kilowatts, step="post", color=GREEN, alpha=0.5, lw=0.0, label="plug"
        )
        power.step(ends, thermal, where="post", color=PURPLE, label="chiller (heater negative)")
        power.set(ylabel="kW", title="power")
        tariff = np.append(schedule.eur_kwh, schedule.eur_kwh[-1])
        price.step(ends, tariff, where="post", color=ORANGE, label="tariff, EUR/kWh")
        worth = plan.worth(course)
        at = [ends[each.step] for each in worth]
        kwh = 0.01 * week.pack.energy_j / 3.6e6
        price.plot(
            at,
            [each.eur_per_percent / kwh for each in worth],
            "v",
            color=BLUE,
            label="charge, EUR/kWh",
        )
        price.plot(
            at, [10.0 * each.eur_per_k for each in worth], "o", color=RED, label="10 K more, EUR"
        )
        price.set(ylabel="EUR", title="tariff, and prices at departures and arrivals")
        for axes in (charge, warmth, power, price):
            for event in course.events:
                axes.axvline(ends[event.step], color=GREY, lw=0.6)
            axes.margins(x=0.0)
            axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4)
        figure.savefig(path, dpi=110, metadata={"Software": None})
