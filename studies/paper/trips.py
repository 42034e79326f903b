"""The runs of the paper and of the studies beside it: settings of `iptm.simulate` by address.

An address, such as ``prediction_horizon/10`` or ``sampling_time/3+12/5``, is the study and what varies in it.
Equal settings are driven once, whatever their addresses.
"""

from __future__ import annotations

from itertools import product
from typing import Any

Settings = dict[str, Any]

CYCLE, VEHICLE = "comprehensive_identified", "paper_identified"
DRY = {"road_friction": 0.9}
"""The paper has no wet road; of unknown friction, its steepest descent makes the safety monitor brake."""
OWN = {"cycle": "comprehensive", "vehicle": "paper_calibrated"}
"""Trip and set of the suite, which were there before the paper's were identified."""
NAMES = {
    "reference": "Reference",
    "reference_energy": "Ref + Energy",
    "reference_aging": "Ref + Aging",
    "reference_energy_aging": "Ref + Energy + Aging",
    "energy_aging": "Energy + Aging",
    "aging": "Aging (proposed)",
}
"""The paper's strategies in the order of its Table IV."""
WEIGHTED = tuple(NAMES)[1:5]
CONTROLLERS: dict[str, Settings] = {
    "reference": {"strategy": "reference", "horizon": "15x1"},
    "aging": {"strategy": "aging", "horizon": "15x1"},
    "multi_horizon": {"strategy": "aging", "horizon": "3x1+5x5"},
    "multi_horizon_cost_to_go": {"strategy": "aging_cost_to_go", "horizon": "3x1+5x5"},
}
SPLITS = {"3+12": (3, 12), "5+10": (5, 10), "8+7": (8, 7), "10+5": (10, 5), "12+3": (12, 3)}
SHORT_S = 20.0
STEPS_S = (2, 5, 8, 10, 15)
LONG_STEPS = (5, 10, 12, 15, 20)


def weighted(base: str, energy_1_j: float = 0.0, aging: float = 0.0) -> Settings:
    """A strategy with weights of its own, on the paper's single horizon."""
    given = {"energy_weight_1_j": energy_1_j, "aging_weight": aging}
    weights = {name: value for name, value in given.items() if value}
    return {"strategy": {"base": base, **weights}, "horizon": "15x1"}


FULL_COST_WEIGHT_1_J = 1e-4
"""lambda_P of J1-4, of which the paper prints the ratio of the weights only: the largest power of ten that
keeps both weights in the paper's ranges with all four ratios."""


def weights(full_cost_1_j: float = FULL_COST_WEIGHT_1_J) -> dict[str, list[Settings]]:
    """The four weights of each strategy (Section IV-C.1), the 1e6 twice as printed.

    Of the vice benchmark, too, the ratio only is printed; it depends on nothing else.
    """
    ratios = {
        "reference_energy_aging": (full_cost_1_j, (1e11, 1e12, 1e13, 1e14)),
        "energy_aging": (1e-4, (5e6, 5e10, 5e11, 5e12)),
    }
    return {
        "reference_energy": [weighted("reference_energy", x) for x in (1e-5, 5e-5, 5e-4, 1e-3)],
        "reference_aging": [weighted("reference_aging", 0.0, x) for x in (1e6, 1e6, 5e7, 1e8)],
        **{
            name: [weighted(name, energy_1_j, ratio * energy_1_j) for ratio in printed]
            for name, (energy_1_j, printed) in ratios.items()
        },
    }


def paper_runs(full_cost_1_j: float = FULL_COST_WEIGHT_1_J) -> dict[str, Settings]:
    """The five studies of the paper but for the choice of weights in Table IV, see `best_weight`."""
    runs = {
        f"weighting/{name}/{number}": settings
        for name, choices in weights(full_cost_1_j).items()
        for number, settings in enumerate(choices, start=1)
    }
    for name in ("reference", "aging"):
        runs[f"strategies/{name}"] = CONTROLLERS[name]
    for length in (5, 10, 15, 20):
        runs[f"prediction_horizon/{length}"] = {"strategy": "aging", "horizon": f"{length}x1"}
    for (name, (short, long)), step_s in product(SPLITS.items(), STEPS_S):
        horizon = f"{short}x1+{long}x{step_s}"
        runs[f"sampling_time/{name}/{step_s}"] = {"strategy": "aging", "horizon": horizon}
    for short, long in product((3, 5), LONG_STEPS):
        horizon = f"{short}x1+{long}x5"
        runs[f"long_horizon/{short}+{long}"] = {"strategy": "aging", "horizon": horizon}
    return runs


LARGEST_GAP, LARGEST_GAPS_M = "gap.max_gap_m", (150.0, 175.0, 200.0, 250.0, 300.0)
"""The largest gap, which the paper does not print, and the values with which the sets are compared."""


def gap_runs() -> dict[str, Settings]:
    """The runs that show what a larger gap gives a longer horizon."""
    long = CONTROLLERS["multi_horizon"]
    short = {f"strategies/{name}": CONTROLLERS[name] for name in ("reference", "aging")}
    return {**short, "long_horizon/3+5": long}


def best_weight(name: str, degradation: dict[str, float]) -> str:
    """The address of the weights of a strategy with the smallest degradation, as the paper chooses."""
    candidates = [address for address in degradation if address.startswith(f"weighting/{name}/")]
    return min(candidates, key=lambda address: degradation[address])


PREVIEWS: dict[str, Settings] = {
    "perfect": {},
    "15_s": {"preview_length_s": 15.0},
    "8_s": {"preview_length_s": 8.0},
    "noise": {"noise_std_m_s": 1.5, "noise_correlation_s": 10.0, "seed": 1},
    "none": {"preview_mode": "none"},
}
CELLS = "environment.initial_cell_temperature_k"
OMITTED: dict[str, Settings] = {
    "s_max_80_m": {"overrides": {"gap.max_gap_m": 80.0}},
    "s_max_150_m": {"overrides": {"gap.max_gap_m": 150.0}},
    "t_init_30_degc": {"overrides": {CELLS: 303.15}},
    "t_init_38_degc": {"overrides": {CELLS: 311.15}},
    "eta_b_0.95": {"overrides": {"pack.battery_efficiency": 0.95}},
    "textbook_cell": {"vehicle": "textbook_cell"},
    "published_chiller": {"vehicle": "published_chiller"},
}


def regeneration_runs() -> dict[str, Settings]:
    """WLTC with the printed regenerative efficiency and with a measured one."""
    return {
        f"regeneration/{share:g}/{name}": OWN
        | {"cycle": "wltc_class3b", "overrides": {"powertrain.regenerative_efficiency": share}}
        | CONTROLLERS[name]
        for share, name in product((0.3, 0.7), ("reference", "multi_horizon_cost_to_go"))
    }


WHOLE_TRIP = {"whole_trip": True, "strategy": "aging", "horizon": "3x1+5x5"}


def further_runs() -> dict[str, Settings]:
    """The studies beyond the paper."""
    compared = {name: driver for name, driver in CONTROLLERS.items() if name != "aging"}
    runs: dict[str, Settings] = {"whole_trip/aging": WHOLE_TRIP}
    for (variation, given), (name, driver) in product(OMITTED.items(), compared.items()):
        runs[f"omitted_parameters/{variation}/{name}"] = driver | given
    for plant, (name, driver) in product(("full_channel", "two_cell"), compared.items()):
        model = {"thermal_model": plant} if plant == "full_channel" else {}
        runs[f"full_channel/{plant}/{name}"] = driver | model
    for cycle, (name, driver) in product(
        ("comprehensive", "wltc_class3b", "us06", "udds", "hwfet"), compared.items()
    ):
        runs[f"cost_to_go/{cycle}/{name}/perfect"] = OWN | {"cycle": cycle} | driver
    default, where = CONTROLLERS["multi_horizon_cost_to_go"], "cost_to_go/comprehensive"
    for name, preview in PREVIEWS.items():
        runs[f"{where}/multi_horizon_cost_to_go/{name}"] = OWN | default | preview
    for name, horizon in {
        "long_horizon": "3x1+12x5+8x15",
        "thermal_phase": "3x1+5x5+10x30t",
    }.items():
        run = OWN | {"strategy": "aging_cost_to_go", "horizon": horizon}
        runs[f"{where}/{name}_cost_to_go/perfect"] = run
    return runs | {f"{where}/whole_trip/perfect": OWN | WHOLE_TRIP}


def merged(run: Settings, given: Settings) -> Settings:
    """Settings of a run with others; overrides of both count."""
    overrides = {**run.get("overrides", {}), **given.get("overrides", {})}
    return {**run, **given, **({"overrides": overrides} if overrides else {})}


def complete(settings: Settings, *, short: bool = False) -> Settings:
    """Settings of `iptm.simulate`; a short version drives some seconds."""
    trip = {"cycle": "us06", "slope": "small", "duration_s": SHORT_S} if short else {}
    return {"cycle": CYCLE, "vehicle": VEHICLE, **DRY, **settings, **trip}
