"""FMUs of the suite, made once for all tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm_controller.options import ControllerOptions
from iptm_core.parameters import load_parameters
from iptm_fmi.controller_unit import controller_unit
from iptm_fmi.fmu_file import VERSIONS, write_fmus
from iptm_fmi.plant_unit import meter_unit, plant_unit

SET = "paper_calibrated"


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with plant and meter of the paper's set for both versions."""
    folder = tmp_path_factory.mktemp("fmus")
    parameters = load_parameters(SET).values
    write_fmus(versions(folder, "plant"), plant_unit(parameters))
    write_fmus(versions(folder, "meter"), meter_unit(parameters))
    return folder


@pytest.fixture(scope="session")
def controllers(made: Path) -> Path:
    """The same folder, with the controller."""
    unit = controller_unit(load_parameters(SET).values, ControllerOptions())
    write_fmus(versions(made, "controller"), unit)
    return made


def versions(folder: Path, name: str) -> dict[int, Path]:
    """Return the files of a unit by version."""
    return {version: folder / f"{name}_{version}.fmu" for version in VERSIONS}
