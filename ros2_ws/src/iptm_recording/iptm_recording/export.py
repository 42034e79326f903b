"""The command `export`: a run, or the messages of a topic, as a Parquet or CSV file for other tools."""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from iptm_core.errors import BagError, IptmError, StateError
from iptm_core.program import refused
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_core.user_input import shown
from iptm_recording.bag_reader import BagReader
from iptm_recording.message_table import message_columns
from iptm_recording.trajectory_reader import read_trajectory

_METADATA_PREFIX = "iptm_"
TRAJECTORY = "trajectory"


@dataclass(frozen=True)
class ExportTable:
    """What is written.

    Attributes:
        columns: values by name, units in the names, all of one length.
        metadata: texts by name: what was exported, and what the run depended on.
    """

    columns: Mapping[str, Sequence[Any]]
    metadata: Mapping[str, str]

    @property
    def row_count(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values())))


def trajectory_table(bag: Path, namespace: str | None = None) -> ExportTable:
    """Return the run of a bag tick by tick: the columns of `iptm_core.trajectory.Trajectory`, and the gap.

    Args:
        bag: whatever `BagReader` opens.
        namespace: of the vehicle; needed only if the bag holds several.

    Raises:
        BagError: the bag cannot be read, holds no complete run, or several and none is named.
    """
    columns = trajectory_columns(read_trajectory(bag, namespace))
    return ExportTable(columns, _metadata(bag, TRAJECTORY, namespace))


def trajectory_columns(trajectory: Trajectory) -> dict[str, list[float]]:
    """Return the columns of a trajectory and the gap."""
    columns = {**trajectory.to_arrays(), "gap_m": trajectory.gap_m}
    return {name: values.tolist() for name, values in columns.items()}


def topic_table(bag: Path, topic: str, namespace: str | None = None) -> ExportTable:
    """Return the messages of a topic, see `message_columns`.

    Args:
        bag: whatever `BagReader` opens.
        topic: full name, or one relative to the vehicle.
        namespace: of the vehicle; needed only if the bag holds several.

    Raises:
        BagError: the bag cannot be read, has no such topic, or its messages make no table.
    """
    name = topic
    if namespace is not None and not topic.startswith("/"):
        prefix = namespace.strip("/")
        name = f"/{prefix}/{topic}" if prefix else f"/{topic}"
    with BagReader(bag) as reader:
        columns = message_columns(reader, reader.resolve(name))
    return ExportTable(columns, _metadata(bag, topic, namespace))


def write_parquet(path: Path, table: ExportTable) -> None:
    """Write a Parquet file; the metadata stand in that of its schema, with `iptm_` in front of the names.

    Raises:
        BagError: the file exists, or cannot be written.
    """
    metadata = {_METADATA_PREFIX + name: text for name, text in table.metadata.items()}
    content = pa.table({name: pa.array(values) for name, values in table.columns.items()})
    _create(path, lambda: pq.write_table(content.replace_schema_metadata(metadata), path))


def read_exported_trajectory(path: Path) -> tuple[Trajectory, dict[str, str]]:
    """Return a trajectory from a Parquet file of `write_parquet`, with the metadata.

    Raises:
        BagError: the file cannot be read, or holds no trajectory.
    """
    try:
        table = pq.read_table(path)
        columns = {name: table[name].to_numpy() for name in TRAJECTORY_COLUMNS}
        trajectory = Trajectory.from_arrays(columns)
    except (OSError, KeyError, pa.ArrowException, StateError) as error:
        raise BagError(f"cannot read a trajectory from {path}: {error}") from None
    texts = {key.decode(): text.decode() for key, text in (table.schema.metadata or {}).items()}
    return trajectory, {key.removeprefix(_METADATA_PREFIX): texts[key] for key in texts}


def write_csv(path: Path, table: ExportTable) -> None:
    """Write a CSV file (RFC 4180, UTF-8, decimal points); numbers have as many digits as read back exactly.

    Raises:
        BagError: the file exists, or cannot be written.
    """

    def write() -> None:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(table.columns)
            writer.writerows(zip(*table.columns.values(), strict=True))

    _create(path, write)


# What a user can ask for by the ending of a file.
WRITERS: Mapping[str, Callable[[Path, ExportTable], None]] = {
    ".parquet": write_parquet,
    ".csv": write_csv,
}
_ENDINGS = " or ".join(WRITERS)


def check_output(path: Path) -> None:
    """Refuse a file that cannot become an export, before the bag is read.

    Raises:
        BagError: it has another ending, or exists.
    """
    if path.suffix not in WRITERS:
        raise BagError(f"output is {shown(str(path))}; allowed: a name that ends in {_ENDINGS}")
    try:
        exists = path.exists() or path.is_symlink()
    except OSError as error:
        raise BagError(f"output {shown(str(path))}: {error.strerror}") from None
    if exists:
        raise BagError(f"{path} exists already; a file is never overwritten")


def _create(path: Path, write: Callable[[], None]) -> None:
    """Write a new file, whole or not at all."""
    check_output(path)
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


def _metadata(bag: Path, table: str, namespace: str | None) -> dict[str, str]:
    with BagReader(bag) as reader:
        texts = reader.run_information().to_custom_data()
    own = {"bag": bag.absolute().name, "table": table, "namespace": namespace or ""}
    return {name: text for name, text in {**texts, **own}.items() if text}


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="export",
        description="Write the run of a bag, one row per tick, or the messages of one topic as a Parquet"
        " or CSV file. Column names include units; Parquet also holds the run information.",
    )
    parser.add_argument("bag", type=Path, help="bag folder or file")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help=f"new file: {_ENDINGS}"
    )
    parser.add_argument(
        "--topic", help="write the messages of this topic, one row each, not the trajectory"
    )
    parser.add_argument("--namespace", help="vehicle to write, if the bag holds several")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Export a bag.

    Returns:
        0 on success, 2 when the bag cannot be read or the file cannot be written.
    """
    given = build_parser().parse_args(arguments)
    try:
        check_output(given.output)
        if given.topic is None:
            table = trajectory_table(given.bag, given.namespace)
        else:
            table = topic_table(given.bag, given.topic, given.namespace)
        WRITERS[given.output.suffix](given.output, table)
    except IptmError as error:
        return refused("export", error)
    print(f"{table.row_count} rows, {len(table.columns)} columns in {given.output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
