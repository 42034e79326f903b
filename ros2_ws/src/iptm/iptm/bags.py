"""Bags and stored runs as runs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from iptm.run import Run
from iptm.simulation import run_of_study
from iptm_controller.settings import ControllerSettings
from iptm_core.aging_laws.parking import AgingSettings
from iptm_core.charging_stop import ChargingStopSettings
from iptm_core.decision_record import DecisionSeries
from iptm_core.declaration import parameter_specs, plain
from iptm_core.errors import BagError, MissingTopicError
from iptm_core.parameters.strict_yaml import parse_yaml
from iptm_core.settings import (
    IntegrationSettings,
    PreviewSettings,
    SamplingSettings,
    TripSettings,
)
from iptm_core.user_input import shown
from iptm_ros.recording.bag_reader import BagReader, read_model_parameters
from iptm_ros.recording.run_information import RunInformation

_STORED = ".parquet"
_GROUPS = (
    TripSettings,
    ControllerSettings,
    AgingSettings,
    ChargingStopSettings,
    PreviewSettings,
    SamplingSettings,
    IntegrationSettings,
)
_DEFAULTS = {spec.name: plain(spec.default) for group in _GROUPS for spec in parameter_specs(group)}
"""Parameters of nodes that are settings of a run; a bag names those that were set."""


def load(path: str | Path, namespace: str | None = None) -> Run:
    """Read the run of a bag, of several trips the last one, or a run of a study.

    Args:
        path: folder or file of a bag, or the .parquet file of a run in a store (which takes pyarrow to read).
        namespace: vehicle to read, if the bag holds several.

    Raises:
        BagError: the bag cannot be read, holds no complete run, or several vehicles and none is named.
        StoreError: the stored run is missing or damaged.
    """
    # The topics are loaded only here: no simulation needs them.
    from iptm_ros.recording.trajectory_reader import (  # noqa: PLC0415
        read_decisions,
        read_trajectory,
    )

    if not isinstance(path, (str, Path)):
        raise BagError(f"bag is {shown(path)}; allowed: the path of a bag")
    path = Path(path)
    if path.suffix == _STORED:
        from iptm.studies.store import read_run  # noqa: PLC0415  as above

        return run_of_study(read_run(path))
    parameters, _ = read_model_parameters(path)
    try:
        decisions = read_decisions(path, namespace)
    except MissingTopicError:  # a controller that does not report them
        decisions = DecisionSeries.from_records([], [])
    with BagReader(path) as reader:
        information = reader.run_information()
    return Run(
        name=path.absolute().name,
        settings=_settings(information),
        parameters=parameters,
        trajectory=read_trajectory(path, namespace),
        decisions=decisions,
    )


def _settings(information: RunInformation) -> dict[str, Any]:
    """Return the choices of a run; none where its bag does not hold the parameters of the nodes."""
    nodes = parse_yaml(information.parameters, "parameters of the run", BagError)
    given = [node for node in nodes.values() if isinstance(node, Mapping)] if nodes else []
    found = {name: node[name] for node in given for name in _DEFAULTS if name in node}
    return {**_DEFAULTS, **found} if found else {}
