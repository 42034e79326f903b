"""A cooperative awareness message in SI units, and its bits: the work of asn1tools, from `cam.asn`.

The reference position is the ground position of the centre of the front side of the vehicle's bounding
box (EN 302 637-2 for station types 3 to 11, EN 302 890-2), not its rear bumper.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, cast

import numpy as np

from iptm_core.errors import MessageError
from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_core.state import FloatArray
from iptm_v2x_bridge.messages.packets import PROTOCOL_VERSION, MessageKind, open_datagram
from iptm_v2x_bridge.rejections import Rejection

PASSENGER_CAR = 5
VEHICLE_TYPES = (0, *range(3, 15))
"""Station types that may be ahead on the road (TS 102 894-2): unknown 0, moped 3, motorcycle, car, bus,
trucks, trailer, special, tram 11, light vehicles of vulnerable road users 12, animal 13, agricultural 14."""

ASSUMED_LENGTH_M = VEHICLE_LENGTH_M
"""Length of a car that does not state it."""
ASSUMED_WIDTH_M = 1.8
"""Width of a vehicle that does not state it: a car's."""
LONGEST_M = {0: 18.75, 6: 18.75, 7: 12.0, 8: 18.75, 9: 18.75, 10: 18.75, 11: 75.0, 14: 18.75}
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
        return isinstance(other, PredictedPath) and all(
            np.array_equal(value, vars(other)[name]) for name, value in vars(self).items()
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
        stated_m = ASSUMED_LENGTH_M if self.length_m is None else self.length_m
        return stated_m + self.uncertain_length_m

    @property
    def uncertain_length_m(self) -> float:
        """How much of this distance is an assumption on the safe side: the vehicle may be shorter."""
        longest_m = LONGEST_M.get(self.station_type, ASSUMED_LENGTH_M)
        uncertain_m = longest_m - ASSUMED_LENGTH_M if self.length_m is None else 0.0
        return uncertain_m + (ASSUMED_TRAILER_M if self.trailer_of_unknown_length else 0.0)


PATH_PREDICTION_ID = 4
MAX_PATH_POINTS = 40

_SCALE_DEG = 1e7
_LATITUDE, _LONGITUDE = 900_000_001, 1_800_000_001
_ELLIPSE, _ORIENTATION = 4095, 3601
_ALTITUDE, _HEADING, _SPEED, _ACCELERATION = 800_001, 3601, 16_383, 161
_LENGTH, _LENGTH_OVER, _WIDTH_OVER, _WIDTH = 1023, 1022, 61, 62
_DELTA, _INTERVAL, _PATH_CONFIDENCE = 131_072, 127, 101
"""What stands for "unavailable" in a field, and the values beyond its range."""
_ALTITUDE_BOUNDS_M = dict(
    enumerate((0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0))
)
"""Errors of the altitude by their code; others stand for "out of range" and "unavailable"."""
_NO_ALTITUDE_BOUND, _BACKWARD, _TRAILER_UNKNOWN_LENGTH = 15, 1, 2
UNAVAILABLE_FIELDS = {
    "curvature": {"value": 1023, "confidence": 7},
    "curvatureMode": "unavailable",
    "yawRate": {"value": 32767, "confidence": 8},
}
_INTERVAL_UNITS_S = {"tenths": 0.1, "tens": 10.0, "seconds": 1.0}


@cache
def specification() -> Any:
    """Return the compiled message types, once per process; not every node that starts reads messages."""
    import asn1tools  # noqa: PLC0415

    text = (resources.files(__package__) / "cam.asn").read_text(encoding="utf-8")
    return asn1tools.compile_string(text, codec="uper")


def decode_fields(type_name: str, payload: bytes) -> Any | Rejection:
    """Return the fields of a type of `cam.asn`, all of them inside their ranges."""
    import asn1tools  # noqa: PLC0415

    try:
        return specification().decode(type_name, payload, check_constraints=True)
    except asn1tools.ConstraintsError:
        return Rejection.CONSTRAINT
    except (asn1tools.Error, NotImplementedError, ValueError):
        return Rejection.DECODING


def _integer(value: float | None, scale: float, unavailable: int) -> int:
    return unavailable if value is None else round(value * scale)


def encode_fields(type_name: str, content: Any) -> bytes:
    """Return the bits of a type of `cam.asn`.

    Raises:
        MessageError: a field is missing or outside the range of the standard.
    """
    import asn1tools  # noqa: PLC0415

    try:
        return cast("bytes", specification().encode(type_name, content, check_constraints=True))
    except asn1tools.Error as reason:
        raise MessageError(f"{type_name} cannot be encoded: {reason}") from reason


def decode_datagram(datagram: bytes) -> tuple[CamMessage, int | None] | Rejection:
    """Return the message in a datagram and its packet's TimestampIts mod 2^32 (None if bare), or why not."""
    opened = open_datagram(datagram, (MessageKind.CAM,))
    if isinstance(opened, Rejection):
        return opened
    message = decode_cam(opened.payload)
    return message if isinstance(message, Rejection) else (message, opened.packet_timestamp_ms)


def decode_cam(payload: bytes) -> CamMessage | Rejection:
    """Read a bare message, whose header has been looked at."""
    fields = decode_fields("CAM", payload)
    if isinstance(fields, Rejection):
        return fields
    basic, (kind, vehicle) = fields["params"]["basic"], fields["params"]["high"]
    position = basic["position"]
    if (
        kind != "vehicle"
        or basic["stationType"] not in VEHICLE_TYPES
        or position["lat"] == _LATITUDE
        or position["lon"] == _LONGITUDE
        or vehicle["speed"]["value"] >= _SPEED - 1
    ):
        return Rejection.INCOMPLETE
    heading, speed_m_s = vehicle["heading"]["value"], vehicle["speed"]["value"] / 100.0
    if heading == _HEADING and speed_m_s >= SLOW_M_S:
        return Rejection.INCOMPLETE
    path = _path(fields["params"].get("extensions", ()), position)
    if isinstance(path, Rejection):
        return path
    length, altitude = vehicle["length"], position["altitude"]["value"]
    axis = position["ellipse"]["major"]
    acceleration, lane = vehicle["longitudinal"]["value"], vehicle.get("lane", -1)
    return CamMessage(
        station_id=fields["header"]["stationId"],
        delta_time_ms=fields["deltaTime"],
        latitude_deg=position["lat"] / _SCALE_DEG,
        longitude_deg=position["lon"] / _SCALE_DEG,
        heading_deg=None if heading == _HEADING else heading / 10.0,
        speed_m_s=speed_m_s,
        reversing=vehicle["direction"] == _BACKWARD,
        acceleration_m_s2=None if acceleration == _ACCELERATION else acceleration / 10.0,
        length_m=None if length["value"] >= _LENGTH_OVER else length["value"] / 10.0,
        trailer_of_unknown_length=length["trailer"] == _TRAILER_UNKNOWN_LENGTH,
        width_m=None if vehicle["width"] >= _WIDTH_OVER else vehicle["width"] / 10.0,
        altitude_m=None if altitude == _ALTITUDE else altitude / 100.0,
        altitude_bound_m=_ALTITUDE_BOUNDS_M.get(position["altitude"]["confidence"]),
        position_bound_m=None if axis >= _ELLIPSE - 1 else axis / 100.0,
        lane=lane if lane >= 0 else None,
        station_type=basic["stationType"],
        path=path,
    )


def _path(extensions: Any, position: dict[str, Any]) -> PredictedPath | Rejection | None:
    """Return the likeliest predicted path with times at all its points; None if there is none."""
    best: PredictedPath | None = None
    for extension in extensions:
        if extension["id"] != PATH_PREDICTION_ID:
            continue
        content = decode_fields("PathPrediction", extension["data"])
        if isinstance(content, Rejection):
            return content
        for path in content["paths"]:
            # The one range that the library does not check: an extended size.
            if len(path["points"]) > MAX_PATH_POINTS:
                return Rejection.CONSTRAINT
            found = _timed_path(path, position)
            if found and (best is None or (found.confidence or 0.0) > (best.confidence or 0.0)):
                best = found
    return best


def _timed_path(path: dict[str, Any], position: dict[str, Any]) -> PredictedPath | None:
    steps = []
    for point in path["points"]:
        unit, count = point.get("deltaTime", ("tenths", _INTERVAL))
        unknown = unit != "seconds" and count == _INTERVAL
        if unknown or not count or _DELTA in {point["lat"], point["lon"]}:
            return None
        steps.append((point["lat"], point["lon"], count * _INTERVAL_UNITS_S[unit]))
    moved = np.cumsum(np.array(steps, dtype=np.float64), axis=0)
    confidence = path["confidence"]
    return PredictedPath(
        times_s=moved[:, 2],
        latitudes_deg=(position["lat"] + moved[:, 0]) / _SCALE_DEG,
        longitudes_deg=(position["lon"] + moved[:, 1]) / _SCALE_DEG,
        confidence=None if confidence == _PATH_CONFIDENCE else confidence / 100.0,
    )


def encode_cam(message: CamMessage) -> bytes:
    """Return a message as bits; a predicted path makes it one of release 2.

    Raises:
        MessageError: a value is outside the range of the standard.
    """
    bound_m = message.altitude_bound_m or math.inf
    fitting = (code for code, known_m in _ALTITUDE_BOUNDS_M.items() if bound_m <= known_m)
    axis = _integer(message.position_bound_m, 100.0, _ELLIPSE)
    orientation = _ORIENTATION if message.position_bound_m is None else 0
    position = {
        "lat": round(message.latitude_deg * _SCALE_DEG),
        "lon": round(message.longitude_deg * _SCALE_DEG),
        "ellipse": {"major": axis, "minor": axis, "orientation": orientation},
        "altitude": {
            "value": _integer(message.altitude_m, 100.0, _ALTITUDE),
            "confidence": next(fitting, _NO_ALTITUDE_BOUND),
        },
    }
    heading = message.heading_deg
    degrees_10 = _HEADING if heading is None else round(heading * 10.0) % 3600
    vehicle: dict[str, Any] = {
        "heading": {"value": degrees_10, "confidence": 127},
        "speed": {"value": round(message.speed_m_s * 100.0), "confidence": 127},
        "direction": _BACKWARD * message.reversing,
        "length": {
            "value": _integer(message.length_m, 10.0, _LENGTH),
            "trailer": _TRAILER_UNKNOWN_LENGTH * message.trailer_of_unknown_length,
        },
        "width": _integer(message.width_m, 10.0, _WIDTH),
        "longitudinal": {
            "value": _integer(message.acceleration_m_s2, 10.0, _ACCELERATION),
            "confidence": 102,
        },
        **UNAVAILABLE_FIELDS,
    }
    if message.lane is not None:
        vehicle["lane"] = message.lane
    params: dict[str, Any] = {
        "basic": {"stationType": message.station_type, "position": position},
        "high": ("vehicle", vehicle),
    }
    if message.path is not None:
        data = encode_fields("PathPrediction", {"paths": [_path_fields(message.path, position)]})
        params["extensions"] = [{"id": PATH_PREDICTION_ID, "data": data}]
    header = {
        "protocolVersion": PROTOCOL_VERSION,
        "messageId": MessageKind.CAM.message_id,
        "stationId": message.station_id,
    }
    content = {"header": header, "deltaTime": message.delta_time_ms, "params": params}
    return encode_fields("CAM", content)


def _path_fields(path: PredictedPath, position: dict[str, Any]) -> dict[str, Any]:
    if path.times_s.size > MAX_PATH_POINTS:
        raise MessageError(
            f"predicted path has {path.times_s.size} points; allowed: 1 to {MAX_PATH_POINTS}"
        )
    # Rounded as absolute values, so that the errors of the steps do not add up.
    latitudes = np.rint(path.latitudes_deg * _SCALE_DEG).astype(np.int64)
    longitudes = np.rint(path.longitudes_deg * _SCALE_DEG).astype(np.int64)
    tenths = np.rint(path.times_s * 10.0).astype(np.int64)
    steps = zip(
        np.diff(latitudes, prepend=position["lat"]).tolist(),
        np.diff(longitudes, prepend=position["lon"]).tolist(),
        np.diff(tenths, prepend=0).tolist(),
        strict=True,
    )
    return {
        "points": [
            {"lat": north, "lon": east, "deltaTime": ("tenths", interval)}
            for north, east, interval in steps
        ],
        "usage": "adasAd",
        "confidence": _integer(path.confidence, 100.0, _PATH_CONFIDENCE),
    }
