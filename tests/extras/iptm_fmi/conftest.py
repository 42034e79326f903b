"""FMUs of the suite, made once for all tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from iptm_controller.options import ControllerOptions
from iptm_core.parameters import load_parameters
from iptm_fmi.controller_unit import controller_unit
from iptm_fmi.fmu_file import write_fmu
from iptm_fmi.plant_unit import meter_unit, plant_unit

SET = "paper_calibrated"


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with plant and meter of the paper's set, and its controller, for both versions."""
    folder = tmp_path_factory.mktemp("fmus")
    parameters = load_parameters(SET).values
    for version in (2, 3):
        write_fmu(folder / f"plant_{version}.fmu", plant_unit(parameters), version)
        write_fmu(folder / f"meter_{version}.fmu", meter_unit(parameters), version)
    return folder


@pytest.fixture(scope="session")
def controllers(made: Path) -> Path:
    """The same folder, with the controller."""
    unit = controller_unit(load_parameters(SET).values, ControllerOptions())
    for version in (2, 3):
        write_fmu(made / f"controller_{version}.fmu", unit, version)
    return made
