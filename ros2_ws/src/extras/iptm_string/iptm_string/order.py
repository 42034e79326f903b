"""A string of vehicles on one road: their order and start positions."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.errors import ScenarioError
from iptm_core.user_input import number

MAX_VEHICLES = 20
"""More do not start on one computer within a reasonable time."""


@dataclass(frozen=True)
class VehicleInString:
    """One vehicle of a string.

    Attributes:
        name: of the vehicle, `car_1` for the first.
        namespace: of its nodes, with a leading slash.
        vehicle_ahead: namespace of the vehicle ahead, empty for the first, which follows the driving cycle.
        vehicle_behind: namespace of the vehicle behind, empty for the last.
        start_position_m: front bumper at the start, along the road; 0 for the first.
    """

    name: str
    namespace: str
    vehicle_ahead: str
    vehicle_behind: str
    start_position_m: float


def vehicle_count(text: str, name: str = "vehicles") -> int:
    """Read the number of vehicles of a string."""
    count = _in_range(name, text, (2.0, MAX_VEHICLES))
    if not count.is_integer():
        raise ScenarioError(f"{name} is {text}; allowed: a whole number, 2 to {MAX_VEHICLES}")
    return int(count)


def _in_range(name: str, text: str, bounds: tuple[float, float], unit: str = "") -> float:
    low, high = bounds
    try:
        value = number(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise ScenarioError(f"{name} is {text}; allowed: {low:g} to {high:g}{unit}")
    return value


def vehicles_in_string(
    count: int, initial_gap_m: float, length_m: float, namespace: str = ""
) -> tuple[VehicleInString, ...]:
    """Return the vehicles of a string, the first one first.

    Args:
        initial_gap_m: from the front bumper of a vehicle to the rear one of the vehicle ahead.
        namespace: around the namespaces of the vehicles, empty for none.
    """
    prefix = "/".join(["", *filter(None, [namespace.strip("/")]), "car_"])
    names = ["", *(f"{prefix}{number}" for number in range(1, count + 1)), ""]
    return tuple(
        VehicleInString(
            name=f"car_{number}",
            namespace=names[number],
            vehicle_ahead=names[number - 1],
            vehicle_behind=names[number + 1],
            start_position_m=-(number - 1) * (initial_gap_m + length_m),
        )
        for number in range(1, count + 1)
    )
