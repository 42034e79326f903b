"""Speed signs (IVIM of TS 103 301; ISO/TS 19321).

What is read: signs "maximum speed" (C 14 of the Vienna Convention, 557 of ISO 14823) and the zones that they
are relevant in, as lines. Left out and counted: all other signs, signs for certain hours or vehicles, and
zones that are areas or computed from others. Lanes are not distinguished, as the own lane is unknown:
a sign over one of them counts for all.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from iptm_core.parameters.model import KM_H_PER_M_S
from iptm_v2x_bridge.messages.mapem import SCALE_DEG
from iptm_v2x_bridge.messages.packets import MessageKind
from iptm_v2x_bridge.messages.pycrate_codec import decode_fields, encode_fields
from iptm_v2x_bridge.rejections import LeftOut, Rejection

KM_H_PER_MILE_H = 1.609344
_LATITUDE, _LONGITUDE, _DELTA = 900_000_001, 1_800_000_001, 131_072
_VIENNA_MAXIMUM_SPEED = (2, 14)
"""Class C, sign 14."""
_ISO_MAXIMUM_SPEED = ("regulatory", 5, 57)
_KM_H, _MILES_H = 0, 1
_CANCELLED = (2, 3)
"""Cancellation, negation."""
_REGULATORY = 1
_UNKNOWN_ELLIPSE = {
    "semiMajorConfidence": 4095,
    "semiMinorConfidence": 4095,
    "semiMajorOrientation": 3601,
}
_UNKNOWN_ALTITUDE = {"altitudeValue": 800_001, "altitudeConfidence": "unavailable"}


class ZoneDirection(IntEnum):
    """Direction of travel for which a zone is relevant, along its line."""

    SAME = 0
    OPPOSITE = 1
    BOTH = 2
    UNSTATED = 3
    """Read as `SAME`."""


@dataclass(frozen=True)
class SpeedZone:
    """A line along which a limit holds.

    Attributes:
        limit_m_s: the limit.
        places_deg: latitudes and longitudes of its vertices, two or more.
        direction: relevant direction of travel.
    """

    limit_m_s: float
    places_deg: tuple[tuple[float, float], ...]
    direction: ZoneDirection = ZoneDirection.SAME


@dataclass(frozen=True)
class SpeedSigns:
    """One message.

    Attributes:
        identity: country (bits of its code), provider, and number of the information.
        zones: where which limit holds.
        issued_ms: TimestampIts of this version of the information, None if not sent.
        valid_from_ms: TimestampIts, None for at once.
        valid_to_ms: TimestampIts, None if the end is not sent.
        is_cancelled: whether the information holds no longer.
        left_out: what of it was left out.
    """

    identity: tuple[int, int, int]
    zones: tuple[SpeedZone, ...]
    issued_ms: int | None = None
    valid_from_ms: int | None = None
    valid_to_ms: int | None = None
    is_cancelled: bool = False
    left_out: tuple[LeftOut, ...] = ()


def decode_ivim(payload: bytes) -> tuple[SpeedSigns] | Rejection:
    """Read a bare message, whose header has been looked at."""
    read = decode_fields(MessageKind.IVIM, payload)
    if isinstance(read, Rejection):
        return read
    _, fields = read
    management = fields["mandatory"]
    containers = fields.get("optional", ())
    left_out: list[LeftOut] = []
    lines: dict[int, tuple[tuple[float, float], ...] | None] = {}
    for kind, content in containers:
        if kind == "glc":
            reference = content["referencePosition"]
            if reference["latitude"] == _LATITUDE or reference["longitude"] == _LONGITUDE:
                return Rejection.INCOMPLETE
            lines |= {part["zoneId"]: _line(part, reference) for part in content["parts"]}
    parts = [part for kind, content in containers if kind == "giv" for part in content]
    provider = management["serviceProviderId"]
    signs = SpeedSigns(
        identity=(
            provider["countryCode"][0],
            provider["providerIdentifier"],
            management["iviIdentificationNumber"],
        ),
        zones=tuple(zone for part in parts for zone in _zones(part, lines, left_out)),
        issued_ms=management.get("timeStamp"),
        valid_from_ms=management.get("validFrom"),
        valid_to_ms=management.get("validTo"),
        is_cancelled=management["iviStatus"] in _CANCELLED,
        left_out=tuple(left_out),
    )
    return (signs,)


def _line(
    part: dict[str, Any], reference: dict[str, int]
) -> tuple[tuple[float, float], ...] | None:
    """Return the vertices of a zone, None if it is not a line or lacks a vertex.

    Each difference is one to the vertex before, the first one to the reference position, where a line of a
    single vertex begins.
    """
    kind, zone = part.get("zone", ("", None))
    if kind != "segment":
        return None
    kind, points = zone["line"]
    latitude, longitude = reference["latitude"], reference["longitude"]
    places = []
    for point in points:
        if kind.startswith("delta"):
            if _DELTA in {point["deltaLatitude"], point["deltaLongitude"]}:
                return None
            latitude += point["deltaLatitude"]
            longitude += point["deltaLongitude"]
        else:
            latitude, longitude = point["latitude"], point["longitude"]
            if latitude == _LATITUDE or longitude == _LONGITUDE:
                return None
        places.append((latitude / SCALE_DEG, longitude / SCALE_DEG))
    if len(places) == 1:
        places.insert(0, (reference["latitude"] / SCALE_DEG, reference["longitude"] / SCALE_DEG))
    return tuple(places)


def _zones(
    part: dict[str, Any],
    lines: dict[int, tuple[tuple[float, float], ...] | None],
    left_out: list[LeftOut],
) -> list[SpeedZone]:
    limits = [_limit_m_s(sign["code"], left_out) for sign in part["roadSignCodes"]]
    known = [limit for limit in limits if limit is not None]
    if not known:
        return []
    if "vehicleCharacteristics" in part or "driverCharacteristics" in part:
        left_out.append(LeftOut.CERTAIN_VEHICLES)
        return []
    direction = ZoneDirection(part.get("direction", ZoneDirection.UNSTATED))
    found = []
    for zone in part.get("relevanceZoneIds", ()):
        line = lines.get(zone)
        if line is None:
            left_out.append(LeftOut.ZONE)
        else:
            found.append(SpeedZone(min(known), line, direction))
    return found


def _limit_m_s(code: tuple[str, Any], left_out: list[LeftOut]) -> float | None:
    """Return what a sign limits the speed to, None where it does not or only at times."""
    kind, sign = code
    value, unit, at_times = None, None, False
    if kind == "viennaConvention":
        if (sign["roadSignClass"], sign["roadSignCode"]) == _VIENNA_MAXIMUM_SPEED:
            value, unit = sign.get("value"), sign.get("unit")
            at_times = "validity" in sign
    elif kind == "iso14823":
        pictogram, attributes = sign["pictogramCode"], dict(sign.get("attributes", ()))
        category = pictogram["pictogramCategoryCode"]
        shown = (
            pictogram["serviceCategoryCode"][1],
            category["nature"],
            category["serialNumber"],
        )
        if shown == _ISO_MAXIMUM_SPEED and "spe" in attributes:
            value, unit = attributes["spe"].get("speedLimitMax"), attributes["spe"]["unit"]
            at_times = bool(attributes.keys() & {"dtm", "edt"})
    scale = {_KM_H: 1.0, _MILES_H: KM_H_PER_MILE_H}.get(-1 if unit is None else unit)
    if at_times:
        left_out.append(LeftOut.CERTAIN_HOURS)
    elif not value or scale is None:
        left_out.append(LeftOut.SIGN)
    else:
        return float(scale * value / KM_H_PER_M_S)
    return None


def encode_ivim(station_id: int, message: SpeedSigns) -> bytes:
    """Return a message of a station as bits, with signs of the Vienna Convention in km/h.

    Raises:
        MessageError: a value is outside the range of the standard.
    """
    country, provider, number = message.identity
    latitude, longitude = (round(value * SCALE_DEG) for value in message.zones[0].places_deg[0])
    management: dict[str, Any] = {
        "serviceProviderId": {"countryCode": (country, 10), "providerIdentifier": provider},
        "iviIdentificationNumber": number,
        "iviStatus": _CANCELLED[0] if message.is_cancelled else 0,
    }
    times = {
        "timeStamp": message.issued_ms,
        "validFrom": message.valid_from_ms,
        "validTo": message.valid_to_ms,
    }
    management |= {name: value for name, value in times.items() if value is not None}
    reference = {
        "latitude": latitude,
        "longitude": longitude,
        "positionConfidenceEllipse": _UNKNOWN_ELLIPSE,
        "altitude": _UNKNOWN_ALTITUDE,
    }
    numbered = list(enumerate(message.zones, start=1))
    parts = [
        {"zoneId": zone_id, "zone": ("segment", {"line": ("deltaPositions", line)})}
        for zone_id, zone in numbered
        for line in [_steps(zone.places_deg, (latitude, longitude))]
    ]
    signs = [_sign_fields(zone_id, zone) for zone_id, zone in numbered]
    location = ("glc", {"referencePosition": reference, "parts": parts})
    content = {"mandatory": management, "optional": [location, ("giv", signs)]}
    return encode_fields(MessageKind.IVIM, station_id, content)


def _steps(
    places_deg: tuple[tuple[float, float], ...], before: tuple[int, int]
) -> list[dict[str, int]]:
    steps = []
    for place_deg in places_deg:
        place = round(place_deg[0] * SCALE_DEG), round(place_deg[1] * SCALE_DEG)
        steps.append(
            {"deltaLatitude": place[0] - before[0], "deltaLongitude": place[1] - before[1]}
        )
        before = place
    return steps


def _sign_fields(zone_id: int, zone: SpeedZone) -> dict[str, Any]:
    sign_class, sign = _VIENNA_MAXIMUM_SPEED
    code = {
        "roadSignClass": sign_class,
        "roadSignCode": sign,
        "vcOption": 0,
        "value": round(zone.limit_m_s * KM_H_PER_M_S),
        "unit": _KM_H,
    }
    return {
        "relevanceZoneIds": [zone_id],
        "direction": int(zone.direction),
        "iviType": _REGULATORY,
        "roadSignCodes": [{"code": ("viennaConvention", code)}],
    }
