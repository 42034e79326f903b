"""Cooperative awareness messages as ROS messages of etsi_its_conversion (etsi_its_cam_msgs/msg/CAM).

Their fields are the integers of EN 302 637-2. They become the bits of a message again, so that everything
behind a socket works in the same way behind a topic, recordings included. The low frequency container is left
out.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from iptm_core.errors import ParameterError
from iptm_v2x_bridge.messages.cam import UNAVAILABLE_FIELDS, encode_fields

PACKAGE = "etsi_its_cam_msgs"
_VEHICLE = 0
"""Choice of the high frequency container."""


def message_type() -> Any:
    """Return the type of the messages.

    Raises:
        ParameterError: its package is not there.
    """
    try:
        return import_module(f"{PACKAGE}.msg").CAM
    except (ImportError, AttributeError):
        raise ParameterError(
            f"cam_topic is given, but {PACKAGE}, which has its type, is not there; allowed: '', or a ROS "
            f"with that package (apt install ros-jazzy-{PACKAGE.replace('_', '-')})"
        ) from None


def bits_of(message: Any) -> bytes:
    """Return the bits of a message.

    Raises:
        MessageError: a field is outside the range of the standard.
    """
    params = message.cam.cam_parameters
    basic, high = params.basic_container, params.high_frequency_container
    place = basic.reference_position
    ellipse = place.position_confidence_ellipse
    position = {
        "lat": place.latitude.value,
        "lon": place.longitude.value,
        "ellipse": {
            "major": ellipse.semi_major_confidence.value,
            "minor": ellipse.semi_minor_confidence.value,
            "orientation": ellipse.semi_major_orientation.value,
        },
        "altitude": _measured(place.altitude, "altitude"),
    }
    header = {
        "protocolVersion": message.header.protocol_version,
        "messageId": message.header.message_id,
        "stationId": message.header.station_id.value,
    }
    container: tuple[str, dict[str, Any]] = ("roadside", {})
    if high.choice == _VEHICLE:
        container = ("vehicle", _vehicle(high.basic_vehicle_container_high_frequency))
    content = {
        "header": header,
        "deltaTime": message.cam.generation_delta_time.value,
        "params": {
            "basic": {"stationType": basic.station_type.value, "position": position},
            "high": container,
        },
    }
    return encode_fields("CAM", content)


def _vehicle(fields: Any) -> dict[str, Any]:
    found = {
        "heading": _measured(fields.heading, "heading"),
        "speed": _measured(fields.speed, "speed"),
        "direction": fields.drive_direction.value,
        "length": {
            "value": fields.vehicle_length.vehicle_length_value.value,
            "trailer": fields.vehicle_length.vehicle_length_confidence_indication.value,
        },
        "width": fields.vehicle_width.value,
        "longitudinal": _measured(fields.longitudinal_acceleration, "longitudinal_acceleration"),
        **UNAVAILABLE_FIELDS,  # not used, and not in the same range in all editions
    }
    if fields.lane_position_is_present:
        found["lane"] = fields.lane_position.value
    return found


def _measured(fields: Any, name: str) -> dict[str, int]:
    return {
        "value": getattr(fields, f"{name}_value").value,
        "confidence": getattr(fields, f"{name}_confidence").value,
    }
