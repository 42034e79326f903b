"""Definitions of message types, and decoding by them."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from iptm_core.errors import BagError
from iptm_ros.recording.message_types import message_definition
from iptm_ros.topics import TOPICS

PREFIXES = [p for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
SHARES = [Path(prefix) / "share" for prefix in (*PREFIXES, sys.prefix)]
INSTALLED = sorted({f"{p.parts[-3]}/msg/{p.stem}" for s in SHARES for p in s.glob("*/msg/*.msg")})


def test_every_installed_type_explains_itself() -> None:
    assert {"nav_msgs/msg/Odometry", "sensor_msgs/msg/BatteryState"} <= set(INSTALLED)
    for type_name in INSTALLED:
        definition = message_definition(type_name)
        assert definition.type_name == type_name
        assert definition.type_hash == _official_hash(type_name)
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(definition.text, type_name))
        store.get_msgdef(type_name)  # fails if a nested type is missing


def _official_hash(type_name: str) -> str:
    package, _, name = type_name.split("/")
    for share in SHARES:
        path = share / package / "msg" / f"{name}.json"
        if path.exists():
            entries = json.loads(path.read_text())["type_hashes"]
            return str(next(e["hash_string"] for e in entries if e["type_name"] == type_name))
    raise AssertionError(type_name)


def test_text_keeps_the_units_in_the_comments() -> None:
    assert "Celsius" in message_definition("sensor_msgs/msg/Temperature").text


def test_short_name_means_the_same() -> None:
    assert message_definition("std_msgs/Float64") is message_definition("std_msgs/msg/Float64")


def test_without_installed_packages_the_type_store_steps_in(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    expected = {spec.type_name: message_definition(spec.type_name) for spec in TOPICS.values()}
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    for type_name, installed in expected.items():
        definition = message_definition(type_name)
        assert definition.type_hash == installed.type_hash
        assert "MSG: " in definition.text or "/" not in definition.text


@pytest.mark.parametrize(
    "name", ["Odometry", "nav_msgs/srv/GetMap", "a/b/c/d", "", "nav msgs/msg/X"]
)
def test_malformed_name(name: str) -> None:
    with pytest.raises(BagError, match="allowed: package/msg/Type"):
        message_definition(name)


def test_unknown_type() -> None:
    with pytest.raises(BagError, match=r"'own_msgs/msg/Thing' is unknown.*not installed"):
        message_definition("own_msgs/msg/Thing")


def test_type_of_a_package_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "share" / "own_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Fluid.msg").write_text("float64 density  # kg/m^3\n")
    (folder / "Tank.msg").write_text(
        "# Comment with std_msgs/Fake in it\nint32 X=3\nstring<=10 short\nfloat64[36] values\n"
        "geometry_msgs/msg/Point[] corners  # with a comment\nFluid[<=4] fluids\n"
    )
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}:{os.environ.get('AMENT_PREFIX_PATH', '')}")
    definition = message_definition("own_msgs/msg/Tank")
    assert "MSG: own_msgs/Fluid\nfloat64 density  # kg/m^3" in definition.text
    assert "MSG: geometry_msgs/Point\n" in definition.text
    assert definition.type_hash == ""
    (folder / "Fluid.msg").unlink()
    with pytest.raises(BagError, match="unknown"):
        message_definition("own_msgs/msg/Other")
