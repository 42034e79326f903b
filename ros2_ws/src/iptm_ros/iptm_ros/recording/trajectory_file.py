"""A trajectory as a Parquet file with texts about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from iptm_core.errors import BagError, StateError
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_core.user_input import shown

_METADATA_PREFIX = "iptm_"


def export_table(columns: Mapping[str, Sequence[Any]], metadata: Mapping[str, str]) -> pa.Table:
    """Return a table of columns of one length with texts about it, `iptm_` in front of their names."""
    texts = {_METADATA_PREFIX + name: text for name, text in metadata.items()}
    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    return table.replace_schema_metadata(texts)


def trajectory_columns(trajectory: Trajectory) -> dict[str, list[float]]:
    """Return the columns of a trajectory and the gap."""
    columns = {**trajectory.to_arrays(), "gap_m": trajectory.gap_m}
    return {name: values.tolist() for name, values in columns.items()}


def write_parquet(path: Path, table: pa.Table) -> None:
    """Write a Parquet file; the texts stand in the metadata of its schema."""
    create(path, lambda: pq.write_table(table, path))


def read_exported_trajectory(path: Path) -> tuple[Trajectory, dict[str, str]]:
    """Return a trajectory from a Parquet file of `write_parquet`, with the metadata."""
    try:
        table = pq.read_table(path)
        stored = set(TRAJECTORY_COLUMNS).intersection(table.column_names)
        trajectory = Trajectory.from_stored({name: table[name].to_numpy() for name in stored})
    except (OSError, KeyError, pa.ArrowException, StateError) as error:
        raise BagError(f"cannot read a trajectory from {path}: {error}") from None
    texts = {key.decode(): text.decode() for key, text in (table.schema.metadata or {}).items()}
    return trajectory, {key.removeprefix(_METADATA_PREFIX): texts[key] for key in texts}


def create(path: Path, write: Callable[[], None]) -> None:
    """Write a new file, whole or not at all.

    Raises:
        BagError: the file exists, or cannot be written.
    """
    try:
        path.open("xb").close()
    except OSError as error:
        raise BagError(f"cannot write {shown(str(path))}: {error.strerror}") from None
    try:
        write()
    except BaseException as error:
        path.unlink(missing_ok=True)
        if isinstance(error, (OSError, pa.ArrowException)):
            raise BagError(f"cannot write {path}: {error}") from None
        raise
