"""Trips of the shipped strategies by the role that they have in a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from studies.savings import BASELINE, PRODUCTION, PRODUCTION_SIMPLE, RULE_PREVIEW

from iptm_controller.horizon import SINGLE_HORIZON
from iptm_controller.settings import ControllerSettings
from iptm_core.parameters import DEFAULT_SET
from iptm_core.units import CELSIUS_ZERO_K

DEFAULT, REFERENCE = "default", "reference"
_CONTROLLER = ControllerSettings()
STRATEGIES = {
    DEFAULT: (_CONTROLLER.strategy, _CONTROLLER.horizon),
    REFERENCE: ("reference", str(SINGLE_HORIZON)),
    **{
        role: (role, _CONTROLLER.horizon)
        for role in (PRODUCTION, PRODUCTION_SIMPLE, BASELINE, RULE_PREVIEW)
    },
}
"""Strategy and grid by the role in the tables; rules have no grid."""


def climate(ambient_c: float) -> dict[str, float]:
    """Return the parameters of a car that was parked outside: its cells have the temperature of the air."""
    names = ("ambient_temperature_k", "initial_cell_temperature_k")
    return {f"environment.{name}": ambient_c + CELSIUS_ZERO_K for name in names}


def trip(
    cycle: str,
    role: str = DEFAULT,
    car: str = DEFAULT_SET,
    ambient_c: float | None = None,
    overrides: Mapping[str, float] | None = None,
    **settings: Any,
) -> dict[str, Any]:
    """Return the arguments of `iptm.simulate` for a trip.

    Args:
        cycle: driving cycle.
        role: one of `STRATEGIES`.
        car: name of its parameter set.
        ambient_c: temperature in degC of the air in which the car was parked; None for the value of the set.
        overrides: further parameters that differ.
        settings: of the trip, as in `iptm.simulate`.
    """
    strategy, horizon = STRATEGIES[role]
    parked = {} if ambient_c is None else climate(ambient_c)
    given = {name: value for name, value in settings.items() if value is not None}
    return {
        "cycle": cycle,
        "strategy": strategy,
        "horizon": horizon,
        "vehicle": car,
        "overrides": {**parked, **(overrides or {})},
        **given,
    }
