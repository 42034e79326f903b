"""Rules for what the paper says about the aging model itself; they need no runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.parameters import load_parameters
from iptm_core.state import FloatArray
from iptm_studies.report.aging_map import AgingMap, aging_map
from iptm_studies.report.rules.base import Printed, Rule
from iptm_studies.report.runs import Results
from iptm_studies.report.verdict import Judgement, Verdict


@dataclass(frozen=True)
class AgingFalls(Rule):
    """Degradation falls with lower current and with lower temperature, everywhere on the map."""

    def needs(self) -> tuple[str, ...]:
        """No runs."""
        return ()

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            "On the whole map of Fig. aging: reproduced if a lower current and a lower temperature lessen "
            "the degradation at each node; in sign only if one of the two does."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Check the differences along both axes."""
        found = aging_map(load_parameters().values)
        by_current = bool(np.all(np.diff(found.loss_per_hour, axis=1) > 0.0))
        by_temperature = bool(np.all(np.diff(found.loss_per_hour[:, 1:], axis=0) > 0.0))
        per_kelvin = _growth(found.temperatures_c, found.loss_per_hour[:, -1])
        verdict = (
            Verdict.REPRODUCED
            if by_current and by_temperature
            else Verdict.SIGN_ONLY
            if by_current or by_temperature
            else Verdict.NOT_REPRODUCED
        )
        return Judgement(
            verdict,
            f"with current: {'everywhere' if by_current else 'not everywhere'}, with temperature: "
            f"{'everywhere' if by_temperature else 'not everywhere'} "
            f"({100.0 * per_kelvin:.2f} % per kelvin at {found.currents_a[-1]:g} A)",
        )


@dataclass(frozen=True)
class AgingExponential(Rule):
    """Degradation grows exponentially with current."""

    temperature_c: float
    least_excess: float

    def needs(self) -> tuple[str, ...]:
        """No runs."""
        return ()

    def text(self, printed: Printed) -> str:  # noqa: ARG002
        """The rule in words."""
        return (
            f"At {self.temperature_c:g} °C: reproduced if the loss per ampere-hour grows by the same factor "
            "for each equal step of current (a straight line on a logarithmic axis) and doubling the current "
            f"to 2C multiplies the loss per hour by at least {2.0 * (1.0 + self.least_excess):g}; in sign "
            "only if it more than doubles."
        )

    def judge(self, results: Results, printed: Printed) -> Judgement:  # noqa: ARG002
        """Check the logarithm of the loss per charge and the factor from 1C to 2C."""
        found = aging_map(load_parameters().values)
        column = np.array(
            [_at(found, self.temperature_c, index) for index in range(found.currents_a.size)]
        )
        moving = found.currents_a > 0.0
        slope = np.diff(np.log(column[moving] / found.currents_a[moving]))
        straight = bool(np.ptp(slope) <= 1e-6 * np.max(np.abs(slope)))
        one_c, two_c = (
            float(np.interp(rate * found.nominal_capacity_ah, found.currents_a, column))
            for rate in (1.0, 2.0)
        )
        factor = two_c / one_c
        if straight and factor >= 2.0 * (1.0 + self.least_excess):
            verdict = Verdict.REPRODUCED
        else:
            verdict = Verdict.SIGN_ONLY if factor > 2.0 else Verdict.NOT_REPRODUCED
        per_c = float(
            np.exp(
                np.mean(slope) / np.diff(found.currents_a[moving])[0] * found.nominal_capacity_ah
            )
        )
        return Judgement(
            verdict,
            f"loss per ampere-hour times {per_c:.2f} per 1C; loss per hour from 1C to 2C times {factor:.2f}",
        )


def _growth(axis: FloatArray, values: FloatArray) -> float:
    """Mean relative growth per unit of an axis."""
    return float(np.exp(np.log(values[-1] / values[0]) / (axis[-1] - axis[0])) - 1.0)


def _at(found: AgingMap, temperature_c: float, column: int) -> float:
    return float(np.interp(temperature_c, found.temperatures_c, found.loss_per_hour[:, column]))
