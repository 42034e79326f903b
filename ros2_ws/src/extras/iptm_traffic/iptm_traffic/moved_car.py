"""A vehicle in SUMO that moves exactly with its plant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from iptm_core.errors import ScenarioError
from iptm_core.state import VehicleState
from iptm_traffic.ego_road import EgoRoad

LOOKED_AHEAD_M = 1000.0
_CHANGE_LANES_NEVER = 0
_OBEY_NOTHING = 0


@dataclass(frozen=True)
class EgoInstant:
    """The ego vehicle at one instant: trip time, front along the road, speed."""

    time_s: float
    position_m: float
    speed_m_s: float


EgoMotion = EgoInstant | VehicleState
"""The ego vehicle as its plant has it, headless or in a message."""


class MovedCar:
    """A vehicle in SUMO that moves exactly with its plant.

    Attributes:
        position_m: latest position from its plant, along the ego vehicle's road.
        speed_m_s: latest speed from its plant.
        largest_deviation_m: how far apart SUMO and plant ever had it.
    """

    def __init__(self, name: str, vehicle: Any, road: EgoRoad) -> None:
        self.name = name
        self._vehicle, self._road = vehicle, road
        self.position_m = self.speed_m_s = self.largest_deviation_m = 0.0

    def sumo_position_m(self) -> float:
        """Return where it is for SUMO, along the road from where the ego vehicle started."""
        lane = self._vehicle.getLaneID(self.name)
        on_lane_m = float(self._vehicle.getLanePosition(self.name))
        found = self._road.position_on(lane, on_lane_m, self.position_m)
        if found is None:
            raise ScenarioError(
                f"{self.name} is on SUMO's lane {lane!r}; allowed: those of its road"
            )
        return found

    def take_over(self, speed_m_s: float) -> bool:
        """Take a car over from SUMO, once it is on the ego vehicle's road; return whether it is.

        Args:
            speed_m_s: what it drives.
        """
        lane, on_lane_m = (
            self._vehicle.getLaneID(self.name),
            self._vehicle.getLanePosition(self.name),
        )
        found = self._road.position_on(lane, float(on_lane_m), self.position_m)
        if found is None or found < 0.0:
            return False
        self.position_m, self.speed_m_s = found, max(speed_m_s, 0.0)
        self.hold()
        return True

    def hold(self) -> None:
        """Leave speed and lane to the plant from now on."""
        self._vehicle.setSpeedMode(self.name, _OBEY_NOTHING)
        self._vehicle.setLaneChangeMode(self.name, _CHANGE_LANES_NEVER)

    def aim(self, position_m: float, speed_m_s: float, step_s: float) -> None:
        """Set the speeds with which SUMO's next step ends at a position."""
        step_m = position_m - self.sumo_position_m()
        before = max(2.0 * step_m / step_s - speed_m_s, 0.0)
        self._vehicle.setPreviousSpeed(self.name, before)
        self._vehicle.setSpeed(self.name, speed_m_s)
        self.position_m, self.speed_m_s = position_m, speed_m_s

    def leader(self) -> tuple[str, float, float] | None:
        """Return name, gap and speed of the car ahead in its lane, None if there is none."""
        found = self._vehicle.getLeader(self.name, LOOKED_AHEAD_M)
        if found is None or not found[0]:
            return None
        gap_m = float(found[1]) + float(self._vehicle.getMinGap(self.name))
        return found[0], gap_m, float(self._vehicle.getSpeed(found[0]))
