"""The car as viewers draw it: its measures, and a URDF of body and battery pack."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from iptm_core.parameters import ModelParameters
from iptm_core.settings import VEHICLE_LENGTH_M
from iptm_ros.topics import EGO_FRAME, PACK_FRAME, frame_in

Triple = tuple[float, float, float]

# The model has none of these: they are for drawing, of a car of the compact class.
WIDTH_M = 1.8
CLEARANCE_M = 0.2
_AXLES_M = (-0.85, -3.55)  # behind the front bumper, where the frame of the body lies
_TYRE_WIDTH_M = 0.2
_PACK_SIZE_M = (2.0, 1.4, 0.12)

PACK_PLACE_M: Triple = (-0.5 * VEHICLE_LENGTH_M, 0.0, CLEARANCE_M + 0.5 * _PACK_SIZE_M[2])
"""Middle of the battery pack in the frame of the body."""


def body_size_m(parameters: ModelParameters) -> Triple:
    """Return length, width and height of the body, whose front has the area of the parameter set."""
    return VEHICLE_LENGTH_M, WIDTH_M, parameters.body.frontal_area_m2 / WIDTH_M


def vehicle_urdf(parameters: ModelParameters, prefix: str = "") -> str:
    """Return the URDF of the ego vehicle: body, wheels and the battery pack in it.

    It has no masses: it is made to be looked at.
    """
    body, pack = frame_in(prefix, EGO_FRAME), frame_in(prefix, PACK_FRAME)
    robot = ET.Element("robot", name="iptm_vehicle")
    size = body_size_m(parameters)
    link = ET.SubElement(robot, "link", name=body)
    place = (-0.5 * VEHICLE_LENGTH_M, 0.0, CLEARANCE_M + 0.5 * size[2])
    _box(link, size, place, "body", (0.0, 0.45, 0.7, 0.5))
    radius_m = parameters.powertrain.wheel_radius_m
    for x in _AXLES_M:
        for y in (-0.5 * (WIDTH_M - _TYRE_WIDTH_M), 0.5 * (WIDTH_M - _TYRE_WIDTH_M)):
            visual = _visual(link, (x, y, radius_m), "tyre", (0.1, 0.1, 0.1, 1.0), "1.570796 0 0")
            ET.SubElement(
                ET.SubElement(visual, "geometry"),
                "cylinder",
                radius=f"{radius_m:g}",
                length=f"{_TYRE_WIDTH_M:g}",
            )
    link = ET.SubElement(robot, "link", name=pack)
    _box(link, _PACK_SIZE_M, (0.0, 0.0, 0.0), "pack", (0.9, 0.6, 0.0, 1.0))
    joint = ET.SubElement(robot, "joint", name=f"{body}_to_{pack}", type="fixed")
    ET.SubElement(joint, "parent", link=body)
    ET.SubElement(joint, "child", link=pack)
    ET.SubElement(joint, "origin", xyz=_words(PACK_PLACE_M), rpy="0 0 0")
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _box(
    link: ET.Element, size_m: Triple, place_m: Triple, name: str, color: tuple[float, ...]
) -> None:
    visual = _visual(link, place_m, name, color)
    ET.SubElement(ET.SubElement(visual, "geometry"), "box", size=_words(size_m))


def _visual(
    link: ET.Element,
    place_m: Triple,
    material: str,
    color: tuple[float, ...],
    rpy: str = "0 0 0",
) -> ET.Element:
    visual = ET.SubElement(link, "visual")
    ET.SubElement(visual, "origin", xyz=_words(place_m), rpy=rpy)
    ET.SubElement(ET.SubElement(visual, "material", name=material), "color", rgba=_words(color))
    return visual


def _words(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:.6g}" for number in numbers)
