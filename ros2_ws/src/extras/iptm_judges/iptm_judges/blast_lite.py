"""Cells of NREL's BLAST-Lite as judges: fits to published tests of calendar and cyclic ageing.

Each simulates the use of `iptm_core.aging_laws.judging` by itself, with the cycles that it counts.
Cells of other anodes, of a second life, and further batches of the same tests are left out.
"""

from __future__ import annotations

import warnings
from importlib import import_module
from importlib.metadata import version

from iptm_core.aging_laws.judging import DAYS, Exposure, Judge
from iptm_core.units import CELSIUS_ZERO_K

models = import_module("blast.models")  # of requirements/judges.txt

GROUP = "BLAST-Lite"
DISTRIBUTION = "blast-lite"
MODELS = {
    "NCA (Panasonic)": "Nca_Gr_Panasonic3Ah_Battery",
    "NMC622 (DENSO)": "Nmc622_Gr_DENSO50Ah_Battery",
    "NMC811-SiGr (LG M50)": "Nmc811_GrSi_LGM50_5Ah_Battery",
    "NMC811-SiGr (LG MJ1)": "Nmc811_GrSi_LGMJ1_4Ah_Battery",
    "NMC111 (Kokam)": "Nmc111_Gr_Kokam75Ah_Battery",
    "NMC111 (Sanyo)": "Nmc111_Gr_Sanyo2Ah_Battery",
    "LFP (Sony-Murata)": "Lfp_Gr_SonyMurata3Ah_Battery",
    "LFP (250 Ah)": "Lfp_Gr_250AhPrismatic",
    "NMC (50 Ah, B1)": "NMC_Gr_50Ah_B1",
}
"""Names of its classes by cell."""
_DAYS_PER_YEAR = 365.0


def judges() -> tuple[Judge, ...]:
    """Return a judge for each cell; the version of the library is part of what is kept of them."""
    of_version = {"release": version(DISTRIBUTION)}
    return tuple(Judge(name, GROUP, loss, {"cell": name, **of_version}) for name in MODELS)


def loss(cell: str, release: str, exposure: Exposure) -> float:  # noqa: ARG001
    """Return the capacity that a new cell loses in `DAYS` of a use, as a share of nominal capacity."""
    use = exposure.repeated()
    series = {
        "Time_s": use.time_s.copy(),
        "SOC": use.charge.copy(),
        "Temperature_C": use.temperature_k - CELSIUS_ZERO_K,
    }
    model = getattr(models, MODELS[cell])()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of NumPy, about names that it still has
        model.simulate_battery_life(series, threshold_time=DAYS / _DAYS_PER_YEAR)
    return 1.0 - float(model.outputs["q"][-1])
