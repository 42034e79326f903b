"""Cells with published ageing laws: parameters, sources, and the range of the experiments behind them.

The parameters of the fits by NREL are facts of the BLAST-Lite 1.1.1 release; the measurements behind them
come from the publications named. Voltages over the state of charge are read off the publication.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial

from iptm_core.aging_laws.law import (
    AgingLaw,
    CalendarAging,
    CrackedFilmGrowth,
    CyclicAging,
    FilmGrowth,
    anode_potential_v,
    depth_intensity,
    linear_intensity,
    voltage_intensity,
)
from iptm_core.physics.cell import ChargeTable
from iptm_core.physics.ops import Scalar


@dataclass(frozen=True)
class Experiments:
    """Range of the experiments that a law was fitted to.

    Attributes:
        calendar_c: cell temperatures of storage tests.
        cycling_c: cell temperatures of cycling tests.
        depth: depths of discharge of cycling tests.
        largest_c_rate_1_h: largest C-rate of cycling tests, charging or discharging.
        days: length of the storage tests, about.
    """

    calendar_c: tuple[float, float]
    cycling_c: tuple[float, float]
    charge: tuple[float, float]
    depth: tuple[float, float]
    largest_c_rate_1_h: float
    days: float


@dataclass(frozen=True)
class AgingCell:
    """A cell, its law, and where that comes from.

    Attributes:
        cell: make and format.
        resistance: law of the growth of resistance, as a share of a new cell's resistance; None without one.
    """

    law: AgingLaw
    cell: str
    source: str
    experiments: Experiments
    resistance: AgingLaw | None = None


def outside_experiments(
    experiments: Experiments,
    calendar_c: tuple[float, float],
    cycling_c: tuple[float, float],
    charge: tuple[float, float],
    depth: float,
    c_rate_1_h: float,
) -> tuple[str, ...]:
    """Return which quantities of a use leave the experiments, in words."""

    def beyond(used: tuple[float, float], tested: tuple[float, float]) -> bool:
        return used[0] < tested[0] - 1e-9 or used[1] > tested[1] + 1e-9

    found = {
        "rest temperature": beyond(calendar_c, experiments.calendar_c),
        "cycling temperature": beyond(cycling_c, experiments.cycling_c),
        "state of charge": beyond(charge, experiments.charge),
        "depth of discharge": beyond((depth, depth), experiments.depth),
        "C-rate": c_rate_1_h > experiments.largest_c_rate_1_h,
    }
    return tuple(name for name, is_outside in found.items() if is_outside)


def _itself(charge: Scalar) -> Scalar:
    return charge


def _zero(charge: Scalar) -> Scalar:
    return 0.0 * charge


_TENTHS = tuple(0.1 * tenth for tenth in range(11))
_SANYO_V = ChargeTable(
    (0.0, 0.05, *_TENTHS[1:]),
    (3.331, 3.420, 3.491, 3.581, 3.627, 3.655, 3.697, 3.775, 3.869, 3.965, 4.073, 4.162),
)
_SANYO_CALENDAR = ChargeTable(
    _SANYO_V.charges, tuple(7.543 * volt - 23.75 for volt in _SANYO_V.values)
)
_SANYO_RESISTANCE = ChargeTable(
    _SANYO_V.charges, tuple(5.270 * volt - 16.32 for volt in _SANYO_V.values)
)
_SANYO_AH_PER_CYCLE = 2.0 * 2.15
_REFERENCE_K = 308.15

NCA = AgingCell(
    AgingLaw(
        "NCA",
        (
            CalendarAging(75.4, 3.34e3, 353.0, 0.512, _itself),
            CyclicAging(
                partial(linear_intensity, 1.86e-6, 4.74e-11, 1.77e-4), (3.34e-11, -2.81e-9), 0.699
            ),
        ),
    ),
    "Panasonic NCR18650B, 3.2 Ah",
    "storage: Keil et al. 2016, doi:10.1149/2.0411609jes; cycling: Preger et al. 2020, "
    "doi:10.1149/1945-7111/abae37; fit: NREL",
    Experiments((25.0, 50.0), (15.0, 35.0), (0.0, 1.0), (0.8, 1.0), 2.0, 300.0),
)
NMC811_SI = AgingCell(
    AgingLaw(
        "NMC811-Si",
        (
            CalendarAging(0.0353, 1.03e3, 57.7, 0.743, _itself),
            CyclicAging(
                partial(linear_intensity, 1.77e-7, 8.08e-13, 2.21e-7), (2.25e3, -1.14e4), 0.695
            ),
        ),
    ),
    "LG MJ1 18650, 3.5 Ah, graphite with silicon",
    "EVERLASTING report D2.3, 2020; fit: NREL",
    Experiments((0.0, 50.0), (0.0, 50.0), (0.1, 0.9), (0.2, 0.8), 3.0, 365.0),
)
NMC111 = AgingCell(
    AgingLaw(
        "NMC111",
        (
            CalendarAging(
                2.66e7,
                17.8 * _REFERENCE_K,
                -5.21 * _REFERENCE_K / 0.123,
                0.357,
                anode_potential_v,
            ),
            CyclicAging(partial(depth_intensity, 3.80e3, 1.04), (-18.4 * _REFERENCE_K,), 0.778),
        ),
    ),
    "Kokam 75 Ah pouch",
    "Smith et al., American Control Conference 2017, doi:10.23919/ACC.2017.7963578; fit: NREL. The loss of "
    "active material after some thousand cycles is left out",
    Experiments((0.0, 55.0), (0.0, 45.0), (0.0, 1.0), (0.8, 1.0), 1.0, 365.0),
    AgingLaw(
        "NMC111, resistance",
        (
            CalendarAging(
                0.0570 * 2.66e7,
                17.8 * _REFERENCE_K,
                -5.21 * _REFERENCE_K / 0.123,
                1.25,
                anode_potential_v,
            ),
            CyclicAging(
                partial(depth_intensity, 4.87 * 3.80e3, 1.04), (-18.4 * _REFERENCE_K,), 0.712
            ),
        ),
    ),
)
NMC111_18650 = AgingCell(
    AgingLaw(
        "NMC111 (18650)",
        (
            CalendarAging(1e6, 6976.0, 0.0, 0.75, _zero, _SANYO_CALENDAR),
            CyclicAging(
                partial(
                    voltage_intensity,
                    7.348e-3,
                    3.667,
                    7.6e-4,
                    4.081e-3,
                    _SANYO_V,
                    _SANYO_AH_PER_CYCLE**0.5,
                ),
                (),
                0.5,
            ),
        ),
    ),
    "Sanyo UR18650E, 2.15 Ah",
    "Schmalstieg et al., J. Power Sources 257, 2014, 325, doi:10.1016/j.jpowsour.2014.02.012",
    Experiments((35.0, 50.0), (35.0, 35.0), (0.0, 1.0), (0.0, 1.0), 1.0, 500.0),
    AgingLaw(
        "NMC111 (18650), resistance",
        (
            CalendarAging(1e5, 5986.0, 0.0, 0.75, _zero, _SANYO_RESISTANCE),
            CyclicAging(
                partial(
                    voltage_intensity,
                    2.153e-4,
                    3.725,
                    -1.521e-5,
                    2.798e-4,
                    _SANYO_V,
                    _SANYO_AH_PER_CYCLE,
                ),
                (),
                1.0,
            ),
        ),
    ),
)
NMC622 = AgingCell(
    AgingLaw("NMC622", (FilmGrowth(), CrackedFilmGrowth())),
    "DENSO, 50 Ah, for cars",
    "Smith et al., J. Electrochem. Soc. 168, 2021, 100530, doi:10.1149/1945-7111/ac2ebd; fit: NREL. "
    "The length of the tests is not part of the release, a year is assumed",
    Experiments((10.0, 60.0), (10.0, 60.0), (0.1, 1.0), (0.1, 1.0), 1.0, 365.0),
)
LFP = AgingCell(
    AgingLaw(
        "LFP",
        (
            CalendarAging(8.37e4, 5.21e3, -3.56e3, 0.526, anode_potential_v),
            CyclicAging(
                partial(linear_intensity, 4.38e-8, 1.68e-7, 1.55e-8), (2.19e3, -1.55e5), 0.828
            ),
        ),
    ),
    "large prismatic, 250 Ah",
    "Gasper et al., J. Energy Storage 73, 2023, 109042, doi:10.1016/j.est.2023.109042; fit: NREL",
    Experiments((10.0, 45.0), (10.0, 45.0), (0.0, 1.0), (0.8, 1.0), 1.0, 365.0),
)

AGING_CELLS = {cell.law.name: cell for cell in (NCA, NMC811_SI, NMC111, NMC111_18650, NMC622, LFP)}
"""All cells, by the name of their law."""

LAWS = {
    re.sub(r"\W+", "_", name.lower()).strip("_"): cell.law for name, cell in AGING_CELLS.items()
}
"""Laws of these cells, by names for settings such as ``nmc811_si``."""
