"""Bags and saved runs as runs."""

from __future__ import annotations

from pathlib import Path

from iptm.run import Run
from iptm.run_file import SUFFIX, load_run
from iptm.trip import Trip
from iptm.trip_files import trip_from
from iptm_core.decision_record import DecisionSeries
from iptm_core.errors import BagError, IptmError, MissingTopicError
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_core.user_input import shown
from iptm_ros.recording.bag_reader import BagReader, read_model_parameters
from iptm_ros.recording.run_information import RunInformation


def load(path: str | Path, namespace: str | None = None) -> Run:
    """Read the run of a bag, of several trips the last one, or a run that `Run.save` wrote.

    Args:
        path: folder or file of a bag, or a file that ends in ``.npz``.
        namespace: vehicle to read, if the bag holds several.

    Raises:
        BagError: the bag cannot be read, holds no complete run, or several vehicles and none is named.
        StoreError: the file of a run cannot be read.
    """
    # The topics are loaded only here: no simulation needs them.
    from iptm_ros.recording.trajectory_reader import (  # noqa: PLC0415
        read_decisions,
        read_trajectory,
    )

    if not isinstance(path, (str, Path)):
        raise BagError(f"bag is {shown(path)}; allowed: the path of a bag")
    path = Path(path)
    if path.suffix == SUFFIX:
        return load_run(path)
    parameters, _ = read_model_parameters(path)
    try:
        decisions = read_decisions(path, namespace)
    except MissingTopicError:  # a controller that does not report them
        decisions = DecisionSeries.from_records([], [])
    with BagReader(path) as reader:
        information = reader.run_information()
    trip = _trip(information)
    return Run(
        name=path.absolute().name,
        settings={} if trip is None else trip.settings,
        parameters=parameters,
        trajectory=read_trajectory(path, namespace),
        decisions=decisions,
        trip=trip,
        information=information,
    )


def _trip(information: RunInformation) -> Trip | None:
    """Return the trip that a bag was recorded of, None where it is not stated in the form of today."""
    try:
        content = parse_yaml(information.extra.get("trip", ""), "trip of the run", BagError)
        return (
            trip_from(content, "trip of the run", information.scenario, Path()) if content else None
        )
    except IptmError:
        return None
