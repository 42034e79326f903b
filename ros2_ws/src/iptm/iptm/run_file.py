"""Runs in files: bags, and files of numpy arrays (.npz)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from iptm.run import Run
from iptm.trip import Trip
from iptm.trip_files import trip_from, trip_text
from iptm_core.decision_record import DecisionSeries
from iptm_core.errors import BagError, IptmError, MissingTopicError, StoreError
from iptm_core.parameters import flat_to_parameters, to_flat_dict
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_core.routes.slope import SlopeProfile
from iptm_core.trajectory import Trajectory
from iptm_core.user_input import shown
from iptm_ros.recording.bag_reader import BagReader, read_model_parameters

SUFFIX = ".npz"
_ABOUT, _TRAJECTORY, _DECISIONS, _SLOPE = "about", "trajectory.", "decisions.", "slope."
_TEXTS = ("name", "wall_time_s", "problems", "warnings")


def load(path: str | Path, namespace: str | None = None) -> Run:
    """Read the run of a bag, of several trips the last one, or a run that `Run.save` wrote.

    Args:
        path: folder or file of a bag, or a file that ends in ``.npz``.
        namespace: vehicle to read, if the bag holds several.

    Raises:
        BagError: the bag cannot be read, holds no complete run, or several vehicles and none is named.
        StoreError: the file of a run cannot be read.
    """
    if not isinstance(path, (str, Path)):
        raise BagError(f"bag is {shown(path)}; allowed: the path of a bag")
    path = Path(path)
    if path.suffix == SUFFIX:
        return _load_run(path)
    with BagReader(path) as reader:
        return read_run(reader, namespace)


def read_run(reader: BagReader, namespace: str | None = None) -> Run:
    """Read the run of an open bag, see `load`."""
    # The topics are loaded only here: no simulation needs them.
    from iptm_ros.recording.trajectory_reader import (  # noqa: PLC0415
        read_decisions,
        read_trajectory,
    )

    try:
        decisions = read_decisions(reader, namespace)
    except MissingTopicError:  # a controller that does not report them
        decisions = DecisionSeries.from_records([], [])
    information = reader.run_information()
    try:
        trip = _trip(information.extra.get("trip", ""), information.scenario)
    except IptmError:  # not stated in the form of today
        trip = None
    return Run(
        name=reader.path.absolute().name,
        settings={} if trip is None else trip.settings,
        parameters=read_model_parameters(reader)[0],
        trajectory=read_trajectory(reader, namespace),
        decisions=decisions,
        trip=trip,
        information=information,
    )


def save_run(run: Run, path: str | Path) -> Path:
    """Write a run to a new file; see `Run.save`."""
    path = Path(path)
    if path.suffix != SUFFIX:
        raise StoreError(f"file is {shown(str(path))}; allowed: a name that ends in {SUFFIX}")
    about = {
        **{name: getattr(run, name) for name in _TEXTS},
        "settings": {name: _plain(value) for name, value in run.settings.items()},
        "parameters": to_flat_dict(run.parameters),
        "trip": "" if run.trip is None or run.trip.own_drive is not None else trip_text(run.trip),
        "trip_name": "" if run.trip is None else run.trip.name,
    }
    arrays: dict[str, Any] = {
        _ABOUT: np.array(json.dumps(about)),
        **{_TRAJECTORY + name: each for name, each in run.trajectory.to_arrays().items()},
        **{_DECISIONS + name: each for name, each in run.decisions.to_arrays().items()},
        **(
            {}
            if run.slope is None
            else {_SLOPE + name: each for name, each in vars(run.slope).items()}
        ),
    }
    try:
        with path.open("xb") as file:
            np.savez_compressed(file, **arrays)
    except FileExistsError:
        raise StoreError(f"{path} exists already; allowed: a new file") from None
    except OSError as error:
        raise StoreError(f"{path} cannot be written: {error.strerror}") from None
    return path


def _load_run(path: Path) -> Run:
    """Read a run from a file of `save_run`.

    Raises:
        StoreError: the file cannot be read, or holds no run.
    """
    try:
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
            arrays = {name: file[name] for name in file.files}
        about = json.loads(str(arrays[_ABOUT]))
        known = {name: about[name] for name in _TEXTS}
        return Run(
            **{**known, "problems": tuple(known["problems"]), "warnings": tuple(known["warnings"])},
            settings=about["settings"],
            parameters=flat_to_parameters(about["parameters"], str(path)),
            trajectory=Trajectory.from_stored(_of(arrays, _TRAJECTORY)),
            decisions=DecisionSeries.from_arrays(_of(arrays, _DECISIONS)),
            slope=_slope(arrays),
            trip=_trip(about["trip"], about["trip_name"]),
        )
    except (OSError, BadZipFile, ValueError, KeyError, TypeError, IptmError) as error:
        raise StoreError(f"{path} holds no run of Run.save: {error}") from None


def _of(arrays: Mapping[str, NDArray[Any]], prefix: str) -> dict[str, NDArray[Any]]:
    return {
        name.removeprefix(prefix): each for name, each in arrays.items() if name.startswith(prefix)
    }


def _slope(arrays: Mapping[str, NDArray[Any]]) -> SlopeProfile | None:
    found = _of(arrays, _SLOPE)
    return SlopeProfile(**found) if found else None


def _trip(text: str, name: str) -> Trip | None:
    if not text:
        return None
    return trip_from(
        parse_yaml(text, "trip of the run", StoreError), "trip of the run", name, Path()
    )


def _plain(value: Any) -> Any:
    """Return a setting as JSON holds it."""
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value if isinstance(value, bool | int | float | str) or value is None else str(value)
