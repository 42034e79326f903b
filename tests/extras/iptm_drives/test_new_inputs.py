"""Files as many programs and mishaps leave them: read right, or refused with the true reason."""

from __future__ import annotations

import re
from datetime import timedelta
from pathlib import Path

import pytest
from tests.extras.iptm_drives.field_drives import BEGIN, is_the_drive
from tests.extras.iptm_drives.new_inputs import KM_H, READ, REFUSED, ROWS, T, V, fit, workbook

from iptm_core.errors import RouteError
from iptm_core.routes.user_csv import read_user_trip


def written(folder: Path, name: str, content: str | bytes) -> Path:
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return file


@pytest.mark.parametrize("program", READ)
def test_the_drive_is_read(tmp_path: Path, program: str) -> None:
    trip = read_user_trip(written(tmp_path, *READ[program]))
    is_the_drive(trip, silent=not trip.notes)


@pytest.mark.parametrize("what", REFUSED)
def test_the_true_reason_is_named(tmp_path: Path, what: str) -> None:
    name, content, reason = REFUSED[what]
    with pytest.raises(RouteError) as caught:
        read_user_trip(written(tmp_path, name, content))
    assert str(tmp_path / name) in str(caught.value)
    message = str(caught.value).replace(str(tmp_path), "")
    assert re.search(reason, message), message


@pytest.mark.parametrize("missing", ["", "places", "speed"])
def test_a_fit_file(tmp_path: Path, missing: str) -> None:
    pytest.importorskip("fitdecode", reason="requirements/can.txt is not installed")
    content = fit(places=missing != "places", speed=missing != "speed")
    trip = read_user_trip(written(tmp_path, "a.fit", content))
    is_the_drive(trip, grade=not missing, silent=True)
    cut = read_user_trip(written(tmp_path, "cut.fit", content[:-40]))
    assert any("damaged behind record" in note for note in cut.notes)


def test_a_workbook(tmp_path: Path) -> None:
    pytest.importorskip("openpyxl", reason="requirements/can.txt is not installed")
    head = ["Time [s]", "Speed [km/h]"]
    titled = [["Trip 7"], [], head, *zip(map(float, T), map(float, KM_H), strict=True)]
    moments = [BEGIN.replace(tzinfo=None) + timedelta(seconds=k) for k in ROWS]
    dated = [["Time", "Speed [m/s]"], *zip(moments, map(float, V), strict=True)]
    for sheets in ({"Notes": [["by hand"]], "Drive": titled}, {"Drive": dated}):
        is_the_drive(read_user_trip(written(tmp_path, "a.xlsx", workbook(sheets))), silent=True)
