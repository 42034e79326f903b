"""What the value of a kelvin on arrival buys: the commuter of Phoenix, and January in Oslo.

    python benchmarks/parked_value.py [--laws nca,lfp]

The default strategy drives the trips of a commuter under the law of each cell, month by month, and years are
composed of them (`iptm_studies.life`). Beside it drive the same controller without cooling, and with a rule:
in the last 15 minutes the compressor runs at full power until the mean of the cells is 25 degC. Savings count
against no cooling, a kilowatt-hour is that of the compressor.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import cache

import numpy as np

from iptm_controller.controller import Controller
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import strategy_by_name
from iptm_core.aging_laws.cells import LAWS
from iptm_core.aging_laws.parking import AgingSettings, ParkedAging
from iptm_core.parameters import load_parameters
from iptm_core.parameters.model import CELSIUS_ZERO_K
from iptm_core.physics.chiller import largest_useful_power_w
from iptm_core.trajectory import Trajectory
from iptm_studies.life.losses import SERVICE_YEARS, losses_by_cause
from iptm_studies.life.trips import CITY, DEFAULT, NO_COOLING, TripMap, nominal_energy_j, trip_map
from iptm_studies.life.usage import CLIMATES, USAGES, Climate
from iptm_studies.life.year import year_of
from iptm_studies.run import controller_options, perform_run
from iptm_studies.run_inputs import RunInputs, resolve_inputs
from iptm_studies.run_spec import RunSpec

NONE, RULE, OWN = "no cooling", "25 degC before arrival", "own law"
JULY, JANUARY = 6, 0
AS_MONTH = {2: 2, 3: 3, 4: 4, 5: 5, 6: 6, 7: 6, 8: 5, 9: 3, 10: 2}
"""Months of Phoenix that stand for others, whose air is within 2.2 K; in winter no cell of the commuter gets
warmer than the lower temperature limit."""
RULE_S = 900.0
RULE_K = 25.0 + CELSIUS_ZERO_K
STARTS_C = {NONE: (16.0, 40.0), RULE: (21.5, 32.0, 40.0)}
"""A trip that is not cooled warms the pack by 3.1 to 3.2 K from any of them."""
ABOVE_AIR_K = (-2.0, 4.0)
"""Starts under the own law, beside the mean of the air of a month."""
GARAGE_C = (-4.5, 15.0, 25.0, 35.0)
COMMUTER = USAGES[0]
PHOENIX, _, OSLO = CLIMATES
_DEFAULTS = ControllerSettings()


class CoolsByRule:
    """Drives as a controller does; its compressor runs by the rule, within the rate of the vehicle."""

    def __init__(self, controller: Controller, power_w: float) -> None:
        """Take a controller, and the power of the rule, 0 for no cooling."""
        self.options = controller.options
        self._controller, self._power_w = controller, power_w

    def decide(self, measured: Measurements) -> Decision:
        """Decide one tick."""
        decision, state = self._controller.decide(measured), measured.state
        if state is None:
            return decision
        kelvin = 0.5 * (state.cell_1_temperature_k + state.cell_n_temperature_k)
        is_late = self.options.trip_duration_s - state.time_s <= RULE_S
        wanted_w = self._power_w if is_late and kelvin > RULE_K else 0.0
        rate_w = load_parameters().values.limits.max_compressor_rate_w_s * self.options.tick_s
        power_w = min(
            max(wanted_w, state.compressor_power_w - rate_w), state.compressor_power_w + rate_w
        )
        return replace(decision, command=replace(decision.command, compressor_power_w=power_w))


def use_of(law: str, climate: Climate, month: int) -> AgingSettings:
    """Return the settings of a commuter in a month."""
    monthly_k = np.array(climate.monthly_c) + CELSIUS_ZERO_K
    return AgingSettings(
        aging_law=law,
        parking_air_k=float(monthly_k[month]),
        parking_air_swing_k=0.5 * climate.daily_range_k,
        year_air_k=float(np.mean(monthly_k)),
        year_air_swing_k=0.5 * float(np.ptp(monthly_k)),
        charging_target=COMMUTER.charging.target,
    )


def trip_inputs(law: str, cycle: str, climate: Climate, month: int, start_c: float) -> RunInputs:
    """Return the inputs of a trip of the default strategy under a law."""
    spec = RunSpec(
        cycle=cycle,
        strategy=strategy_by_name(_DEFAULTS.strategy),
        overrides=(("environment.initial_cell_temperature_k", start_c + CELSIUS_ZERO_K),),
        horizon=_DEFAULTS.horizon,
        **asdict(use_of(law, climate, month)),
    )
    return resolve_inputs(spec)


def controller_of(inputs: RunInputs) -> Controller:
    """Return the controller of a trip."""
    options = controller_options(inputs.spec, inputs.route.duration_s)
    return Controller(inputs.parameters, options)


def drive(law: str, climate: Climate, month: int, start_c: float, control: str) -> Trajectory:
    """Drive a trip."""
    inputs = trip_inputs(law, CITY, climate, month, start_c)
    if control == OWN:
        return perform_run(inputs).trajectory
    parameters = inputs.parameters
    power_w = largest_useful_power_w(parameters.chiller, parameters.limits)
    ruled = CoolsByRule(controller_of(inputs), power_w if control == RULE else 0.0)
    return perform_run(inputs, own_controller=ruled).trajectory


class Trips:
    """Trips by law, climate, month, start and control, driven when they are asked for."""

    def __init__(self) -> None:
        """Begin without any."""
        self.driven: dict[tuple[str, str, int, float, str], Trajectory] = {}

    def run(
        self, law: str, climate: Climate, month: int, start_c: float, control: str
    ) -> Trajectory:
        """Return a trip."""
        key = law, climate.name, month, start_c, control
        if key not in self.driven:
            self.driven[key] = drive(law, climate, month, start_c, control)
        return self.driven[key]

    def by_month(self, law: str, control: str) -> Callable[[int], TripMap]:
        """Return the trips of the months in Phoenix."""
        energy_j = nominal_energy_j(load_parameters().values)

        def of(month: int) -> TripMap:
            if control != OWN or month not in AS_MONTH:
                ruled = NONE if control == OWN else control
                runs = [self.run(law, PHOENIX, JULY, each, ruled) for each in STARTS_C[ruled]]
            else:
                driven = AS_MONTH[month]
                starts_c = [
                    round(PHOENIX.monthly_c[driven] + above_k, 1) for above_k in ABOVE_AIR_K
                ]
                runs = [self.run(law, PHOENIX, driven, each, OWN) for each in starts_c]
            return trip_map(runs, energy_j)

        return cache(of)


def phoenix(laws: Sequence[str], trips: Trips) -> None:
    """Print savings and energy of year and July."""
    parameters = load_parameters().values
    july = replace(PHOENIX, monthly_c=(PHOENIX.monthly_c[JULY],) * 12)
    print(f"{'law':14} {'period':7} {'control':24} saved, points   kWh")
    for law in laws:
        for period, climate in (("year", PHOENIX), ("July", july)):
            found = {}
            for control in (NONE, RULE, OWN):
                by_month = trips.by_month(law, control)
                of = by_month if period == "year" else lambda _, by=by_month: by(JULY)
                kind = NO_COOLING if control == NONE else DEFAULT
                year = year_of(COMMUTER, climate, kind, COMMUTER.charging, of, parameters)
                lost = sum(losses_by_cause(LAWS[law], year, SERVICE_YEARS).values())
                found[control] = lost, year.compressor_kwh
            for control in (RULE, OWN):
                saved = 100.0 * (found[NONE][0] - found[control][0])
                print(f"{law:14} {period:7} {control:24} {saved:8.2f} {found[control][1]:11.1f}")
            saved, ruled = (found[NONE][0] - found[control][0] for control in (OWN, RULE))
            print(
                f"{law:14} {period:7} own law beside the rule: {100 * saved / ruled:.0f} % of its saving, "
                f"{100 * found[OWN][1] / found[RULE][1]:.0f} % of its energy",
                flush=True,
            )


def oslo(laws: Sequence[str], trips: Trips) -> None:
    """Print what a kelvin is worth and costs in January, from a street and from garages."""
    print("Oslo, January: compressor energy of a trip in kWh by the temperature at its start")
    for law in laws:
        for start_c in GARAGE_C:
            trip = trips.run(law, OSLO, JANUARY, start_c, OWN)
            kwh = float(np.sum(trip.compressor_power_w[1:] * np.diff(trip.time_s))) / 3.6e6
            use = use_of(law, OSLO, JANUARY)
            parked = ParkedAging(LAWS[law], use, use.parking_air_k)
            end_k = 0.5 * (trip.cell_1_temperature_k[-1] + trip.cell_n_temperature_k[-1])
            worth = float(parked.kelvin_price_1_k(np.array([end_k]))[0])
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
    laws, trips = parser.parse_args(arguments).laws.split(","), Trips()
    phoenix(laws, trips)
    oslo(laws, trips)
    return 0


if __name__ == "__main__":
    sys.exit(main())
