"""The list of test cars: consumption of all cars with one drivetrain."""

from __future__ import annotations

import numpy as np

from iptm_core.markdown import render_page
from iptm_validation.measurements import DynamometerTest
from iptm_validation.models.epa_drivetrain import (
    OneDrivetrain,
    consumption_wh_km,
    wheel_energies_wh_km,
    within_make,
)
from iptm_validation.outcome import Comparison, Curve, Figure, Outcome


def compare_cars(tests: tuple[DynamometerTest, ...], drivetrain: OneDrivetrain) -> Outcome | None:
    """Compare the consumptions, on the cars that were not fitted and on all, None without a car."""
    others = [test for test in tests if test.car not in drivetrain.fitted_on]
    if not others:
        return None
    figures = []
    curves = []
    for part, chosen in (("cars not fitted", others), ("all cars", list(tests))):
        modelled = [consumption_wh_km(wheel_energies_wh_km(test), drivetrain) for test in chosen]
        errors = [
            100.0 * (model / test.consumption_wh_km - 1.0)
            for model, test in zip(modelled, chosen, strict=True)
        ]
        within = within_make(errors, [test.make for test in chosen])
        label = f"{part}, {len(chosen)} tests"
        figures += [
            Figure("consumption, mean", label, float(np.mean(errors)), "%", -2.0, 2.0),
            Figure("consumption, deviation", label, float(np.std(errors, ddof=1)), "%", None, 9.5),
        ]
        if np.isfinite(within):
            figures.append(Figure("consumption, within a make", label, within, "%", None, 5.0))
        if part == "cars not fitted":
            order = np.argsort([test.consumption_wh_km for test in chosen])
            curves.append(
                Curve(
                    label,
                    float(np.mean(errors)),
                    np.arange(1.0, len(order) + 1.0, dtype=np.float64),
                    np.array([test.consumption_wh_km for test in chosen])[order] / 10.0,
                    np.array(modelled)[order] / 10.0,
                )
            )
    return Outcome(
        key="epa",
        title="EPA: consumption of electric cars on the dynamometer",
        text=render_page(__package__, "cars.md.j2", drivetrain=drivetrain),
        figures=tuple(figures),
        comparisons=(
            Comparison(
                "epa_consumption",
                "Consumption from the grid on UDDS and HWFET",
                "test, in the order of consumption",
                "kWh/100 km",
                "mean error in %",
                tuple(curves),
            ),
        ),
    )
