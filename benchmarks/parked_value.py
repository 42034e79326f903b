"""What the value of a kelvin on arrival buys: the commuter of Phoenix, and January in Oslo.

    python benchmarks/parked_value.py [--laws nca,lfp]

The default strategy drives the trips of a commuter under the law of each cell, month by month, and years are
composed of them (`iptm.studies.life`). It is compared with the same controller without cooling, and with a
rule: in the last 15 minutes the compressor runs at full power until the mean of the cells is 25 degC. Savings
count against no cooling, a kilowatt-hour is that of the compressor.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import cache

from iptm.studies.drives import DEFAULT, spec_of
from iptm.studies.life.charging_stop import RuledCompressor
from iptm.studies.life.losses import SERVICE_YEARS, losses_by_cause
from iptm.studies.life.own_law import kelvin_price_1_k, use_in
from iptm.studies.life.trips import (
    CITY,
    NO_COOLING,
    TripMap,
    compressor_j,
    mean_cell_k,
    nominal_energy_j,
    trip_map,
)
from iptm.studies.life.usage import CLIMATES, USAGES, Climate
from iptm.studies.life.year import year_of
from iptm.studies.run import controller_options, perform_run
from iptm.studies.study import planned_run
from iptm_controller.controller import Controller
from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.physics.chiller import largest_useful_power_w
from iptm_core.state import VehicleState
from iptm_core.trajectory import Trajectory

NONE, RULE, OWN = "no cooling", "25 degC before arrival", "own law"
JULY, JANUARY = 6, 0
AS_MONTH = {2: 2, 3: 3, 4: 4, 5: 5, 6: 6, 7: 6, 8: 5, 9: 3, 10: 2}
"""Months of Phoenix that stand for others, whose air is within 2.2 K; in winter no cell of the commuter gets
warmer than the lower temperature limit."""
RULE_S = 900.0
RULE_K = 25.0 + CELSIUS_ZERO_K
STARTS_C: Mapping[str, Sequence[float]] = {NONE: (16.0, 40.0), RULE: (21.5, 32.0, 40.0)}
"""A trip that is not cooled warms the pack by 3.1 to 3.2 K from any of them."""
ABOVE_AIR_K = (-2.0, 4.0)
"""Starts under the own law, relative to the mean of the air of a month."""
GARAGE_C = (-4.5, 15.0, 25.0, 35.0)
COMMUTER = USAGES[0]
PHOENIX, _, OSLO = CLIMATES


def use_of(law: str, climate: Climate, month: int) -> AgingSettings:
    """Return the settings of a commuter in a month."""
    return use_in(LAWS[law].name, climate, month, charging_target=COMMUTER.target)


@cache
def drive_under(law: str, climate: Climate, month: int, start_c: float, control: str) -> Trajectory:
    """Drive a trip of the default strategy under a law."""
    start = {"environment.initial_cell_temperature_k": start_c + CELSIUS_ZERO_K}
    inputs = planned_run(spec_of(CITY, overrides=start, **asdict(use_of(law, climate, month))))
    if control == OWN:
        return perform_run(inputs).trajectory
    parameters, end_s = inputs.parameters, inputs.route.duration_s
    largest_w = largest_useful_power_w(parameters.chiller, parameters.limits)
    rate_w = parameters.limits.max_compressor_rate_w_s * inputs.spec.tick_s

    def power_w(state: VehicleState) -> float:
        kelvin = 0.5 * (state.cell_1_temperature_k + state.cell_n_temperature_k)
        cools = control == RULE and end_s - state.time_s <= RULE_S and kelvin > RULE_K
        running_w = state.compressor_power_w
        return min(max(largest_w if cools else 0.0, running_w - rate_w), running_w + rate_w)

    controller = Controller(parameters, controller_options(inputs.spec, end_s))
    return perform_run(inputs, own_controller=RuledCompressor(controller, power_w)).trajectory


def trips_of_months(law: str, control: str) -> list[TripMap]:
    """Return the trips of the months in Phoenix."""
    found = []
    for month in range(12):
        driven, ruled = JULY, NONE if control == OWN else control
        starts_c = STARTS_C[ruled]
        if control == OWN and month in AS_MONTH:
            driven, ruled = AS_MONTH[month], OWN
            monthly_c = PHOENIX.monthly_c[driven]
            starts_c = [round(monthly_c + above_k, 1) for above_k in ABOVE_AIR_K]
        runs = [drive_under(law, PHOENIX, driven, start_c, ruled) for start_c in starts_c]
        found.append(trip_map(runs, nominal_energy_j(load_parameters().values)))
    return found


def phoenix(laws: Sequence[str]) -> None:
    """Print savings and energy of year and July."""
    parameters = load_parameters().values
    july = replace(PHOENIX, monthly_c=(PHOENIX.monthly_c[JULY],) * 12)
    print(f"{'law':14} {'period':7} {'control':24} saved, points   kWh")
    for law in laws:
        for period, climate in (("year", PHOENIX), ("July", july)):
            found = {}
            for control in (NONE, RULE, OWN):
                by_month = trips_of_months(law, control)
                of = by_month if period == "year" else [by_month[JULY]] * 12
                kind = NO_COOLING if control == NONE else DEFAULT
                year = year_of(COMMUTER, climate, kind, of, parameters)
                lost = sum(losses_by_cause(LAWS[law], year, SERVICE_YEARS).values())
                found[control] = lost, year.compressor_kwh
            for control in (RULE, OWN):
                saved = 100.0 * (found[NONE][0] - found[control][0])
                print(f"{law:14} {period:7} {control:24} {saved:8.2f} {found[control][1]:11.1f}")
            saved, ruled = (found[NONE][0] - found[control][0] for control in (OWN, RULE))
            print(
                f"{law:14} {period:7} own law against the rule: {100 * saved / ruled:.0f} % of its saving, "
                f"{100 * found[OWN][1] / found[RULE][1]:.0f} % of its energy",
                flush=True,
            )


def oslo(laws: Sequence[str]) -> None:
    """Print what a kelvin is worth and costs in January, from a street and from garages."""
    print("Oslo, January: compressor energy of a trip in kWh by the temperature at its start")
    for law in laws:
        for start_c in GARAGE_C:
            trip = drive_under(law, OSLO, JANUARY, start_c, OWN)
            kwh = compressor_j(trip) / 3.6e6
            use = use_of(law, OSLO, JANUARY)
            end_k = float(mean_cell_k(trip)[-1])
            worth = kelvin_price_1_k(use, end_k)
            print(
                f"{law:14} {start_c:5.1f} degC: {kwh:.4f} kWh, on arrival {end_k - 273.15:.1f} degC, "
                f"a kelvin is worth {1e6 * worth:.3f}e-6",
                flush=True,
            )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--laws", default=",".join(LAWS), help="separated by commas")
    laws = parser.parse_args(arguments).laws.split(",")
    phoenix(laws)
    oslo(laws)
    return 0


if __name__ == "__main__":
    sys.exit(main())
