from __future__ import annotations

import re
import runpy
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest
import setuptools

import iptm_interfaces
from iptm_interfaces.topics import TOPICS

SOURCE = Path(iptm_interfaces.__file__).parent.parent


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
    assert manifest.findtext("name") == setup_arguments["name"] == "iptm_interfaces"
    assert manifest.findtext("version") == setup_arguments["version"]
    maintainer = manifest.find("maintainer")
    assert maintainer is not None
    assert re.fullmatch(r"[\w.]+@[\w.]+\.\w+", maintainer.get("email", ""))


def test_manifest_names_every_message_package() -> None:
    if not (SOURCE / "package.xml").exists():
        pytest.skip("installed without its sources")
    manifest = ET.parse(SOURCE / "package.xml").getroot()  # noqa: S314  our own file
    depends = {element.text for element in manifest.findall("exec_depend")}
    used = {spec.type_name.split("/", maxsplit=1)[0] for spec in TOPICS.values()}
    assert used <= depends


def test_packages_and_data_are_shipped(setup_arguments: dict[str, Any]) -> None:
    assert set(setup_arguments["packages"]) == {"iptm_interfaces", "iptm_interfaces.codecs"}
    for pattern in setup_arguments["package_data"]["iptm_interfaces"]:
        assert list((SOURCE / "iptm_interfaces").glob(pattern)), pattern
    for _, files in setup_arguments["data_files"]:
        assert all((SOURCE / file).exists() for file in files)
