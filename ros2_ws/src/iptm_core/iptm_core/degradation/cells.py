"""Cells with published ageing laws, and the paper's.

The numbers are those of NREL's BLAST-Lite 1.1.1 (P. Gasper, K. Smith and others, BSD-3-Clause), which were fitted to the
experiments named with each cell; `benchmarks/blast_comparison.py` compares the losses. NMC111 leaves out the loss of
active material, which limits the capacity behind a knee only.
"""

from __future__ import annotations

from iptm_core.degradation.forms import (
    ArrheniusTafel,
    PaperCyclic,
    SmithCalendar,
    SmithCyclic,
    ThroughputBowl,
    ThroughputDepth,
)
from iptm_core.degradation.law import DegradationLaw, ValidRange
from iptm_core.parameters.model import ModelParameters
from iptm_core.parameters.units import CELSIUS_ZERO_K


def _celsius(low: float, high: float) -> tuple[float, float]:
    return low + CELSIUS_ZERO_K, high + CELSIUS_ZERO_K


_NORMAL_K = 35.0 + CELSIUS_ZERO_K
"""Temperature by which the fit of the Kokam cell divides."""
_SMITH = SmithCalendar(
    37000.0, (-0.000197, 0.0101, -0.0157, 0.00835), coupling_1_k=-4.06e-6, hot_1_k=3.32e-5
)

CELLS = (
    DegradationLaw(
        "NCR18650B",
        "NCA",
        (
            ArrheniusTafel(75.4, -3.34e3, 353.0, 0.512),
            ThroughputBowl(1.86e-6, 4.74e-11, 1.77e-4, 3.34e-11, 2.81e-9, 0.699),
        ),
        ValidRange(_celsius(15.0, 35.0), (0.0, 1.0), 2.0),
        "calendar: P. Keil et al., J. Electrochem. Soc. 163 (2016) A1872; cyclic: Y. Preger et al., "
        "J. Electrochem. Soc. 167 (2020) 120532",
    ),
    DegradationLaw(
        "INR18650-MJ1",
        "NMC811 with silicon",
        (
            ArrheniusTafel(0.0353, -1.03e3, 57.7, 0.743),
            ThroughputBowl(1.77e-7, 8.08e-13, 2.21e-7, 2.25e3, 1.14e4, 0.695),
        ),
        ValidRange(_celsius(0.0, 50.0), (0.1, 0.9), 3.0),
        "EVERLASTING, deliverable D2.3 (2020)",
    ),
    DegradationLaw(
        "Kokam 75 Ah",
        "NMC111",
        (
            ArrheniusTafel(
                2.66e7,
                -17.8 * _NORMAL_K,
                -5.21 * _NORMAL_K / 0.123,
                0.357,
                potential=True,
            ),
            ThroughputDepth(3.80e3, -18.4 * _NORMAL_K, 1.04, 0.778),
        ),
        ValidRange(_celsius(0.0, 45.0), (0.0, 1.0), 1.0),
        "K. Smith et al., American Control Conference (2017), doi 10.23919/ACC.2017.7963578",
    ),
    DegradationLaw(
        "prismatic 250 Ah",
        "LFP",
        (
            ArrheniusTafel(8.37e4, -5.21e3, -3.56e3, 0.526, potential=True),
            ThroughputBowl(4.38e-8, 1.68e-7, 1.55e-8, 2.19e3, 1.55e5, 0.828),
        ),
        ValidRange(_celsius(10.0, 45.0), (0.0, 1.0), 1.0),
        "P. Gasper et al., J. Energy Storage 73 (2023) 109042",
    ),
    DegradationLaw(
        "DENSO 50 Ah",
        "NMC622",
        (_SMITH, SmithCyclic(_SMITH, (3.24, -58000.0, 2.1, -0.099), (1.44, -13000.0), 0.985)),
        ValidRange(_celsius(10.0, 60.0), (0.0, 1.0), 1.0),
        "K. Smith et al., J. Electrochem. Soc. 168 (2021) 100530",
    ),
)
"""Cells with calendar and cyclic ageing."""


def paper_law(parameters: ModelParameters) -> DegradationLaw:
    """Return the paper's law: cyclic ageing only, for the paper's cell."""
    return DegradationLaw(
        "paper",
        "as in the paper",
        (PaperCyclic(parameters.aging, parameters.cell),),
        ValidRange(
            (parameters.limits.min_temperature_k, parameters.limits.max_temperature_k),
            (0.0, 1.0),
            10.0,
        ),
        "Li et al., eq. (11) and (12)",
    )
