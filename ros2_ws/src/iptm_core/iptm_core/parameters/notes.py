"""Parameters that belong together: a note where one is overridden and its neighbours are not."""

from __future__ import annotations

from collections.abc import Iterator

from iptm_core.parameters.chiller_table import AMBIENT_KEY
from iptm_core.parameters.flat import SourceTag
from iptm_core.parameters.loading import ParameterSet

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
        ("cell.resistance_temperature_coefficient_1_k",),
        "the resistance in the cold belongs to the cell",
    ),
    (
        (AMBIENT_KEY,),
        ("environment.initial_cell_temperature_k",),
        "a car that has stood in the open has cells of that temperature",
    ),
)
"""Keys, keys that belong to them, and why."""
_AIR_KEY = "cooling.air_exchange_w_k"


def belonging_notes(parameters: ParameterSet) -> Iterator[str]:
    """Yield a note for each group of which a part is overridden, and for an override without effect."""
    overridden = {
        key for key, source in parameters.sources.items() if source.tag is SourceTag.OVERRIDE
    }
    for keys, neighbours, reason in _BELONG:
        changed = [key for key in keys if key in overridden]
        kept = [
            f"{key} ({parameters.sources[key].value:g} {parameters.sources[key].unit})"
            for key in neighbours
            if key not in overridden
        ]
        if changed and kept:
            yield (
                f"{', '.join(changed)} is overridden, {', '.join(kept)} is that of {parameters.name}:"
                f" {reason}"
            )
    if AMBIENT_KEY in overridden and parameters.values.cooling.air_exchange_w_k == 0.0:
        yield (
            f"{AMBIENT_KEY} moves nothing but the chiller: {_AIR_KEY} of {parameters.name} is 0,"
            " and no cabin is modelled"
        )
