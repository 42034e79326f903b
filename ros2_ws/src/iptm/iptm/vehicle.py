"""A user-defined car: car and cell by name, a pack, and single parameters."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from iptm_core.errors import ParameterError
from iptm_core.parameters import DEFAULT_SET, field_specs, load_parameters
from iptm_core.parameters.catalogue import FITTED_CAR, cells, pack_entries
from iptm_core.parameters.loading import belonging_notes
from iptm_core.user_input import check_known, shown

_LAYOUT = re.compile(r"(\d{1,3})s(\d{1,3})p")


@dataclass(frozen=True, init=False)
class Vehicle:
    """A car of one's own, for ``vehicle=`` of `simulate`, `sweep` and `Trip`.

        iptm.Vehicle("volkswagen_id4", mass_kg=2200, cell="lg_e78", pack="96s3p")

    A cell brings its resistance in the cold, heat capacity and voltage along, and a pack its heat transfer to
    the coolant and the air and its constants of ageing; the car keeps its chiller.

    Attributes:
        name: car or parameter set by name (`available_parameter_sets`), or the path of a .yaml file.
        overrides: parameters in which it differs from that, by dotted key.
    """

    name: str
    overrides: Mapping[str, float]

    def __init__(
        self,
        name: str = DEFAULT_SET,
        *,
        cell: str | None = None,
        pack: str | None = None,
        **parameters: float,
    ) -> None:
        """Put the car together.

        Args:
            name: see the attributes.
            cell: by name, see `cell_names`; None keeps the car's.
            pack: cells in series and parallel, such as ``96s3p``; None keeps the car's, or with another cell
                its cells in series and about its energy.
            parameters: in the unit of the model, by the last part of their key, such as ``mass_kg``.

        Raises:
            ParameterError: a name or a value is not allowed.
        """
        model = load_parameters(name).values
        overrides: dict[str, float] = {}
        if cell is not None:
            check_known(cell, cells(), "vehicle", "cell")
            own, layout = cells()[cell], model.pack
            series, parallel = layout.cells_in_series, layout.parallel
            parallel = max(1, round(parallel * model.cell.nominal_capacity_ah / own.capacity_ah))
            if pack is not None:
                series, parallel = _layout(pack)
            modules = math.gcd(series, layout.modules)
            i3, paper = load_parameters(FITTED_CAR).values, load_parameters().values
            entries = pack_entries(own, modules, series, parallel, i3, paper)
            overrides = {key: entry.value for key, entry in entries.items()}
        elif pack is not None:
            raise ParameterError(f"pack is {shown(pack)} without a cell; allowed: with cell=")
        for short, value in parameters.items():
            check_known(short, _keys(), "vehicle", "parameter")
            overrides[_keys()[short]] = value
        object.__setattr__(self, "name", str(name))
        object.__setattr__(self, "overrides", overrides)
        load_parameters(self.name, overrides)

    @property
    def notes(self) -> tuple[str, ...]:
        """Parameters that were changed without their neighbours."""
        return tuple(belonging_notes(load_parameters(self.name, self.overrides)))


def cell_names() -> tuple[str, ...]:
    """Names of the cells for `Vehicle`."""
    return tuple(cells())


def _layout(pack: Any) -> tuple[int, int]:
    found = _LAYOUT.fullmatch(pack) if isinstance(pack, str) else None
    if found is None:
        raise ParameterError(f"pack is {shown(pack)}; allowed: such as '96s3p'")
    return int(found[1]), int(found[2])


@cache
def _keys() -> Mapping[str, str]:
    """Dotted keys by their last part, which is different for every parameter."""
    return {key.rpartition(".")[2]: key for key in field_specs()}
