"""Parameters that belong together: a note where one is overridden and its neighbours are not."""

from __future__ import annotations

from collections.abc import Iterator

from iptm_core.parameters.chiller_table import AMBIENT_KEY
from iptm_core.parameters.flat import SourceTag
from iptm_core.parameters.loading import ParameterSet

_COLD_LAWS = ("cell.resistance_temperature_coefficient_1_k", "cell.resistance_exponent_1_k")
"""Linear and exponential law of the resistance; the second one counts where it is not 0."""
_BELONG = (
    (
        ("cell.heat_capacity_j_k", "cell.nominal_capacity_ah"),
        ("cooling.convective_coefficient_w_k",),
        "heat transfer between cell and coolant belongs to the size of the cell",
    ),
    (
        ("cell.nominal_capacity_ah",),
        ("cell.heat_capacity_j_k", "cell.nominal_resistance_ohm"),
        "heat capacity and resistance belong to the size of the cell",
    ),
    (
        ("cell.nominal_resistance_ohm",),
        _COLD_LAWS,
        "the resistance in the cold belongs to the cell",
    ),
    (
        (AMBIENT_KEY,),
        ("environment.initial_cell_temperature_k",),
        "a car that has stood in the open has cells of that temperature",
    ),
)
"""Keys, keys that belong to them, and why."""
_DENSITY_KEY = "body.air_density_kg_m3"
_AIR_KEY = "cooling.air_exchange_w_k"


def belonging_notes(parameters: ParameterSet) -> Iterator[str]:
    """Yield a note for each group of which a part is overridden, and for an override without effect."""
    values = parameters.values
    overridden = {
        key for key, source in parameters.sources.items() if source.tag is SourceTag.OVERRIDE
    }
    has_exponent = values.cell.resistance_exponent_1_k > 0.0
    unused = _COLD_LAWS[0 if has_exponent else 1]
    for keys, neighbours, reason in _BELONG:
        changed = [key for key in keys if key in overridden]
        kept = [
            f"{key} ({parameters.sources[key].value:g} {parameters.sources[key].unit})"
            for key in neighbours
            if key not in overridden and key != unused
        ]
        if changed and kept:
            yield (
                f"{', '.join(changed)} is overridden, {', '.join(kept)} is that of {parameters.name}:"
                f" {reason}"
            )
    if AMBIENT_KEY in overridden:
        moved = ["the chiller"]
        moved += ["the exchange of the pack with the air"] * (values.cooling.air_exchange_w_k > 0.0)
        moved += ["drag"] * (_DENSITY_KEY in overridden)
        yield (
            f"{AMBIENT_KEY} moves {' and '.join(moved)}, in {parameters.name} not tyres, driveline and cabin"
            + ("" if _DENSITY_KEY in overridden else f", nor drag ({_DENSITY_KEY})")
            + ("" if values.cooling.air_exchange_w_k else f", nor the pack ({_AIR_KEY} is 0)")
        )
