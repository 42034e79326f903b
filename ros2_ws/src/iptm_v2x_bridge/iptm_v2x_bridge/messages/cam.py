"""A cooperative awareness message in SI units: what of it this project reads and writes.

The reference position is the ground position of the centre of the front side of the vehicle's bounding
box (EN 302 637-2 for station types 3 to 11, EN 302 890-2), not its rear bumper.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_core.state import FloatArray

PASSENGER_CAR = 5
VEHICLE_TYPES = range(3, 12)
"""Station types of motor vehicles: moped 3, motorcycle, car, bus, trucks, trailer, special, tram 11."""

ASSUMED_LENGTH_M = VEHICLE_LENGTH_M
"""Length of a car that does not state it."""
ASSUMED_WIDTH_M = 1.8
"""Width of a vehicle that does not state it: that of a car."""
LONGEST_M = {6: 18.75, 7: 12.0, 8: 18.75, 9: 18.75, 10: 18.75, 11: 75.0}
"""Length of other vehicles that do not state it, by station type: the longest bus, motor vehicle and road
train of directive 96/53/EC (annex I), and the longest tram of BOStrab (section 34)."""
SLOW_M_S = 3.0
"""Below it, a heading from a satellite receiver is noise."""
ASSUMED_TRAILER_M = 14.0
"""Length added for a trailer of unknown length: the rear bumper is rather taken too near than too far."""


@dataclass(frozen=True, eq=False)
class PredictedPath:
    """Path announced by the sender for its reference point.

    Attributes:
        times_s: times after the generation, shape (n,), increasing, above 0.
        latitudes_deg: latitudes, shape (n,).
        longitudes_deg: longitudes, shape (n,).
        confidence: probability that this path is taken, 0 to 1; None if not sent.
    """

    times_s: FloatArray
    latitudes_deg: FloatArray
    longitudes_deg: FloatArray
    confidence: float | None = None

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, PredictedPath)
            and self.confidence == other.confidence
            and np.array_equal(self.times_s, other.times_s)
            and np.array_equal(self.latitudes_deg, other.latitudes_deg)
            and np.array_equal(self.longitudes_deg, other.longitudes_deg)
        )

    __hash__ = None  # type: ignore[assignment]  # arrays have none either


@dataclass(frozen=True)
class CamMessage:
    """One message. What a sender may leave out is None where it did.

    Attributes:
        station_id: identity of the station; changes with its pseudonym.
        delta_time_ms: time of generation, TimestampIts modulo 65,536 ms.
        latitude_deg: reference position, centre of the front.
        longitude_deg: reference position.
        heading_deg: direction of motion, clockwise from north; may be missing below `SLOW_M_S` only.
        speed_m_s: speed, never negative.
        reversing: whether it drives backwards.
        acceleration_m_s2: longitudinal acceleration.
        length_m: length of the vehicle.
        trailer_of_unknown_length: whether a trailer comes on top of the length.
        width_m: width of the vehicle.
        altitude_m: height above the WGS84 ellipsoid.
        altitude_bound_m: 95 % bound of its error.
        position_bound_m: semi-major axis of the 95 % ellipse of the position.
        lane: lane, 1 for the outermost one that is driven on.
        station_type: type of the station, 5 for a passenger car.
        path: its predicted path (release 2).
    """

    station_id: int
    delta_time_ms: int
    latitude_deg: float
    longitude_deg: float
    heading_deg: float | None
    speed_m_s: float
    reversing: bool = False
    acceleration_m_s2: float | None = None
    length_m: float | None = None
    trailer_of_unknown_length: bool = False
    width_m: float | None = None
    altitude_m: float | None = None
    altitude_bound_m: float | None = None
    position_bound_m: float | None = None
    lane: int | None = None
    station_type: int = PASSENGER_CAR
    path: PredictedPath | None = None

    @property
    def front_to_rear_m(self) -> float:
        """Distance from the reference position back to the rear end, trailers included."""
        return self._least_length_m + self.uncertain_length_m

    @property
    def uncertain_length_m(self) -> float:
        """How much of this distance is an assumption on the safe side: the vehicle may be shorter."""
        longest_m = LONGEST_M.get(self.station_type, ASSUMED_LENGTH_M)
        uncertain_m = longest_m - ASSUMED_LENGTH_M if self.length_m is None else 0.0
        return uncertain_m + (ASSUMED_TRAILER_M if self.trailer_of_unknown_length else 0.0)

    @property
    def _least_length_m(self) -> float:
        return ASSUMED_LENGTH_M if self.length_m is None else self.length_m
