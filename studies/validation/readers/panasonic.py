"""Tests of a Panasonic NCR18650PF cell (Kollmeyer, Wisconsin-Madison): ``.mat`` and compact files."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from studies.validation.measurements import CellTest
from studies.validation.readers.columns import block_means, compact_table

from iptm.parts import CELSIUS_ZERO_K, FloatArray, MeasurementError

_NAME = re.compile(r"(?P<name>(?P<minus>n?)(?P<degrees>\d+)degC_(?P<cycle>.+?))(_Pan18650PF)?$")
_FIELDS = ("Time", "Voltage", "Current", "Ah", "Battery_Temp_degC")
_SMALLEST_CURRENT_A = 0.02
_THINNED_S = 1.6


def is_compact_panasonic(head: list[str]) -> bool:
    """True for the first lines of a compact file of cell tests."""
    return head[0].startswith("test,time_s,voltage_v,current_a,charge_ah")


def _name_of(text: str) -> re.Match[str] | None:
    found = _NAME.search(text)
    charging = found is not None and re.search(
        r"ch(ar)?g|pause|trickle", found["cycle"], re.IGNORECASE
    )
    return None if charging else found


def _test(found: re.Match[str], raw: dict[str, FloatArray]) -> CellTest | None:
    """Return the test from its first current on, None if there is none."""
    time_s, current_a = raw["Time"], -raw["Current"]
    flowing = np.flatnonzero(np.abs(current_a) > _SMALLEST_CURRENT_A)
    if len(flowing) == 0:
        return None
    start = max(int(flowing[0]) - 1, 0)
    time_s, current_a = time_s[start:], current_a[start:]
    charge_ah = raw["Ah"][start:]
    step_s = np.diff(time_s, prepend=time_s[0])
    drawn_c = 3600.0 * -np.diff(charge_ah, prepend=charge_ah[0])
    # Where samples were left out, the charge counter has the mean current between them.
    thinned = step_s > _THINNED_S
    mean_a = np.where(thinned, drawn_c / np.maximum(step_s, 1e-3), current_a)
    degrees = float(found["degrees"]) * (-1.0 if found["minus"] else 1.0)
    return CellTest(
        name=found["name"],
        chamber_k=degrees + CELSIUS_ZERO_K,
        time_s=time_s - time_s[0],
        current_a=current_a,
        mean_current_a=mean_a,
        voltage_v=raw["Voltage"][start:],
        discharged_ah=charge_ah[0] - charge_ah,
        case_temperature_k=raw["Battery_Temp_degC"][start:] + CELSIUS_ZERO_K,
    )


def compact_cell_tests(path: Path) -> list[CellTest]:
    """Read all tests of a compact file."""
    names = ("time_s", "voltage_v", "current_a", "charge_ah", "cell_temperature_c")
    table = compact_table(path, ("test", *names))
    found = []
    for name, rows in table.groupby("test", sort=False):
        match = _name_of(str(name))
        if match is not None:
            columns = (rows[each].to_numpy(dtype=np.float64) for each in names)
            found.append(_test(match, dict(zip(_FIELDS, columns, strict=True))))
    return [test for test in found if test is not None]


def original_cell_tests(path: Path) -> list[CellTest]:
    """Read one ``.mat`` file, drive cycles as means over a second.

    Raises:
        MeasurementError: it is another test, the file is damaged, or it lacks a field of ``meas``.
    """
    match = _name_of(path.stem)
    if match is None:
        raise MeasurementError("its name belongs to no drive cycle or pulse test")
    try:
        loaded = loadmat(path, squeeze_me=True, struct_as_record=False)
    except (OSError, ValueError, NotImplementedError) as error:
        raise MeasurementError(f"{path.name} is not readable: {error}") from error
    measured = loaded.get("meas")
    missing = [field for field in _FIELDS if not hasattr(measured, field)]
    if missing:
        raise MeasurementError(f"{path.name} lacks {', '.join(missing)} in `meas`")
    raw = {field: np.asarray(getattr(measured, field), dtype=np.float64) for field in _FIELDS}
    increasing = np.concatenate([[True], np.diff(raw["Time"]) > 0.0])
    raw = {field: values[increasing] for field, values in raw.items()}
    size = round(1.0 / float(np.median(np.diff(raw["Time"]))))
    if size > 1 and "HPPC" not in match["cycle"].upper():
        raw = {field: block_means(values, size) for field, values in raw.items()}
    test = _test(match, raw)
    return [] if test is None else [test]
