"""One run as one Parquet file: trajectory and answers as columns, everything else as JSON metadata.

Any Parquet reader opens the files. A digest over columns and metadata is kept inside, so that damage is
found whatever part of the file it hits.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from iptm_core.decision_record import DECISION_COLUMNS, DecisionSeries
from iptm_core.errors import IptmError, StoreError
from iptm_core.metrics import figure_values
from iptm_core.parameters import flat_to_parameters, to_flat_dict
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_studies.run_spec import RunSpec, canonical_json
from iptm_studies.single_run import WallTimes, WholeTripRecord, WholeTripSolve
from iptm_studies.stored_run import RunRecord, StoredRun

FORMAT = 2
METADATA_KEY = b"iptm"
DIGEST_KEY = b"iptm_digest"
DECISION_PREFIX = "decision_"


def write_run(path: Path, run: StoredRun) -> None:
    """Write a run; the caller sees to it that nobody reads a half-written file.

    Raises:
        OSError: the file cannot be written.
    """
    columns = _columns(run)
    content = canonical_json(_metadata(run)).encode()
    digest = _digest(columns, content)
    table = pa.table(columns, metadata={METADATA_KEY: content, DIGEST_KEY: digest})
    pq.write_table(table, path, compression="zstd", write_page_checksum=True)


def read_run(path: Path) -> StoredRun:
    """Read a run and check it.

    Raises:
        StoreError: the file is missing, damaged or not of this format.
    """
    try:
        table = pq.read_table(path, page_checksum_verification=True, memory_map=False)
        metadata = table.schema.metadata or {}
        content = metadata[METADATA_KEY]
        columns = {
            name: column.combine_chunks()
            for name, column in zip(table.column_names, table.columns, strict=True)
        }
        sound = metadata[DIGEST_KEY] == _digest(columns, content)
        run = _run(json.loads(content), columns)
    except KeyError as error:
        raise StoreError(
            f"stored run {path.name}: {error} is missing; no result of this format"
        ) from error
    except (OSError, pa.ArrowException, ValueError, TypeError, AttributeError) as error:
        raise StoreError(f"stored run {path.name}: cannot be read: {_one_line(error)}") from error
    except IptmError as error:
        raise StoreError(f"stored run {path.name}: {error}") from error
    if not sound:
        raise StoreError(f"stored run {path.name} is damaged: content and digest disagree")
    return run


def read_spec(path: Path) -> RunSpec:
    """Read only the specification of a stored run, without a check of the numbers.

    Raises:
        StoreError: the file is missing, damaged or not of this format.
    """
    try:
        metadata = pq.read_schema(path).metadata or {}
        return RunSpec.from_dict(json.loads(metadata[METADATA_KEY])["spec"])
    except (OSError, pa.ArrowException, ValueError, TypeError, KeyError, IptmError) as error:
        raise StoreError(f"stored run {path.name}: cannot be read: {_one_line(error)}") from error


def _columns(run: StoredRun) -> dict[str, pa.Array]:
    columns = {name: pa.array(values) for name, values in run.trajectory.to_arrays().items()}
    if run.decisions is not None:
        for name, column in run.decisions.to_arrays().items():
            # The last row of a trajectory ends the trip: nothing is decided there.
            values = pa.array(column)
            columns[DECISION_PREFIX + name] = pa.concat_arrays([values, pa.nulls(1, values.type)])
    return columns


def _metadata(run: StoredRun) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "key": run.key,
        "spec": run.spec.to_dict(),
        "parameters": to_flat_dict(run.parameters),
        "whole_trip": None if run.whole_trip is None else asdict(run.whole_trip),
        "record": asdict(run.record),
        # For other readers of the file; here the figures are worked out anew.
        "figures": figure_values(run.metrics),
    }


def _run(content: dict[str, Any], columns: dict[str, pa.Array]) -> StoredRun:
    if content["format"] != FORMAT:
        raise StoreError(f"format is {content['format']}; readable is {FORMAT}")
    record = content["record"]
    return StoredRun(
        key=content["key"],
        spec=RunSpec.from_dict(content["spec"]),
        parameters=flat_to_parameters(content["parameters"], "stored parameters"),
        trajectory=Trajectory.from_arrays(
            {name: columns[name].to_numpy() for name in TRAJECTORY_COLUMNS}
        ),
        decisions=_decisions(columns),
        whole_trip=_whole_trip(content["whole_trip"]),
        record=RunRecord(**{**record, "wall": WallTimes(**record["wall"])}),
    )


def _decisions(columns: dict[str, pa.Array]) -> DecisionSeries | None:
    if DECISION_PREFIX + DECISION_COLUMNS[0] not in columns:
        return None
    arrays = {name: columns[DECISION_PREFIX + name] for name in DECISION_COLUMNS}
    return DecisionSeries.from_arrays(
        {
            name: column.slice(0, len(column) - 1).to_numpy(zero_copy_only=False)
            for name, column in arrays.items()
        }
    )


def _whole_trip(content: dict[str, Any] | None) -> WholeTripRecord | None:
    if content is None:
        return None
    solves = tuple(WholeTripSolve(**solve) for solve in content["solves"])
    return WholeTripRecord(**{**content, "solves": solves})


def _digest(columns: dict[str, pa.Array], content: bytes) -> bytes:
    digest = hashlib.sha256(content)
    for name in sorted(columns):
        digest.update(name.encode())
        digest.update(str(columns[name].type).encode())
        values = columns[name]
        # What lies under a null is undefined, so only its place counts.
        digest.update(values.is_null().to_numpy(zero_copy_only=False).tobytes())
        known = values.drop_null().to_numpy(zero_copy_only=False)
        digest.update(known.tobytes())
    return digest.hexdigest().encode()


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
