from __future__ import annotations

import re
import runpy
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import setuptools

import iptm_v2x_bridge
from iptm_v2x_bridge import node

SOURCE = Path(iptm_v2x_bridge.__file__).parent.parent


@pytest.fixture
def setup_arguments(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    if not (SOURCE / "setup.py").exists():
        pytest.skip("installed without its sources")
    captured: dict[str, Any] = {}
    monkeypatch.setattr(setuptools, "setup", captured.update)
    monkeypatch.chdir(SOURCE)
    runpy.run_path("setup.py")
    return captured


def test_setup_and_manifest_agree(setup_arguments: dict[str, Any]) -> None:
    manifest = ET.parse(SOURCE / "package.xml").getroot()  # noqa: S314  our own file
    assert manifest.get("format") == "3"
    assert manifest.findtext("name") == setup_arguments["name"] == "iptm_v2x_bridge"
    assert manifest.findtext("version") == setup_arguments["version"]
    maintainer = manifest.find("maintainer")
    assert maintainer is not None
    assert re.fullmatch(r"[\w.]+@[\w.]+\.\w+", maintainer.get("email", ""))


def test_console_script_and_module_start_the_same_node(setup_arguments: dict[str, Any]) -> None:
    (script,) = setup_arguments["entry_points"]["console_scripts"]
    assert script == "bridge = iptm_v2x_bridge.node:main"
    assert callable(node.main)


def test_packages_and_data_are_shipped(setup_arguments: dict[str, Any]) -> None:
    assert set(setup_arguments["packages"]) == {"iptm_v2x_bridge"}
    for pattern in setup_arguments["package_data"]["iptm_v2x_bridge"]:
        assert list((SOURCE / "iptm_v2x_bridge").glob(pattern)), pattern
    for _, files in setup_arguments["data_files"]:
        assert all((SOURCE / file).exists() for file in files)
