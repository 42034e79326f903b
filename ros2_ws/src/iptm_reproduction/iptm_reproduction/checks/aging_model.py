"""Checks of the paper's statements about the aging model itself; they need no runs."""

from __future__ import annotations

import numpy as np

from iptm_core.parameters import load_parameters
from iptm_reproduction.aging import aging_map
from iptm_reproduction.check import Check, Finding, graded
from iptm_reproduction.runs import Results


def aging_falls() -> Check:
    """Check that degradation falls with lower current and with lower temperature, everywhere on the map."""

    def judge(_: Results) -> Finding:
        found = aging_map(load_parameters().values)
        loss, temperatures = found.loss_per_hour, found.temperatures_c
        by_current = bool(np.all(np.diff(loss, axis=1) > 0.0))
        by_temperature = bool(np.all(np.diff(loss[:, 1:], axis=0) > 0.0))
        growth = np.log(loss[-1, -1] / loss[0, -1]) / (temperatures[-1] - temperatures[0])
        return Finding(
            graded(by_current and by_temperature, by_current or by_temperature),
            f"with current: {_where(by_current)}, with temperature: {_where(by_temperature)} "
            f"({100.0 * (np.exp(growth) - 1.0):.2f} % per kelvin at {found.currents_a[-1]:g} A)",
        )

    return Check(
        "On the whole map of Fig. aging: reproduced if a lower current and a lower temperature lessen the "
        "degradation at each node; in sign only if one of the two does.",
        (),
        judge,
    )


def aging_exponential(temperature_c: float, least_excess: float) -> Check:
    """Check that degradation grows exponentially with current.

    Args:
        temperature_c: temperature at which it is looked at.
        least_excess: by which part doubling the current must more than double the loss per hour.
    """

    def judge(_: Results) -> Finding:
        found = aging_map(load_parameters().values)
        currents, one_c_a = found.currents_a, found.nominal_capacity_ah
        loss = np.array(
            [np.interp(temperature_c, found.temperatures_c, row) for row in found.loss_per_hour.T]
        )
        moving = currents > 0.0
        steps = np.diff(np.log(loss[moving] / currents[moving]))
        straight = bool(np.ptp(steps) <= 1e-6 * np.max(np.abs(steps)))
        one_c, two_c = np.interp([one_c_a, 2.0 * one_c_a], currents, loss)
        factor = float(two_c / one_c)
        per_c = float(np.exp(np.mean(steps) / np.diff(currents[moving])[0] * one_c_a))
        return Finding(
            graded(straight and factor >= 2.0 * (1.0 + least_excess), factor > 2.0),
            f"loss per ampere-hour times {per_c:.2f} per 1C; loss per hour from 1C to 2C times {factor:.2f}",
        )

    return Check(
        f"At {temperature_c:g} °C: reproduced if the loss per ampere-hour grows by the same factor for each "
        "equal step of current (a straight line on a logarithmic axis) and doubling the current to 2C "
        f"multiplies the loss per hour by at least {2.0 * (1.0 + least_excess):g}; in sign only if it more "
        "than doubles.",
        (),
        judge,
    )


def _where(everywhere: bool) -> str:  # noqa: FBT001
    return "everywhere" if everywhere else "not everywhere"
