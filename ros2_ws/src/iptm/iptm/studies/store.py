"""The store of results: a folder with one Parquet file per key.

Series are columns, everything else is JSON metadata; any Parquet reader opens the files. Parquet's own
checksums cover the pages. A digest over columns and metadata is kept inside as well, so that damage is found
whatever part of the file it hits.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import logging
import os
import re
import uuid
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import pyarrow as pa
import pyarrow.parquet as pq

from iptm.run import Report
from iptm.studies.run import Run
from iptm.studies.run_spec import RunSpec, canonical_json
from iptm.studies.study import KEY_LENGTH
from iptm_core.decision_record import DECISION_COLUMNS, DecisionSeries
from iptm_core.errors import IptmError, StoreError
from iptm_core.metrics import figure_values
from iptm_core.parameters import flat_to_parameters, to_flat_dict
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory

LOGGER = logging.getLogger(__name__)
DEFAULT_FOLDER = "results"
ROOT_VARIABLE = "IPTM_ROOT"
FORMAT = 8
_RECORD = (
    "wall_time_s",
    "compiled",
    "finished_at_utc",
    "git_revision",
    "versions",
    "fingerprint",
)
"""What a file states on where a run comes from."""
_METADATA = b"iptm"
_DIGEST = b"iptm_digest"
_DECISION_PREFIX = "decision_"
_SUFFIX = ".parquet"
_DAMAGED = ".damaged"
_FAILED = ".failed"
_TEMPORARY = ".unfinished-"
_KEY = re.compile(rf"[0-9a-f]{{{KEY_LENGTH}}}")

Content = dict[str, Any]
Columns = Mapping[str, Any]
Read = TypeVar("Read")


class ResultStore:
    """Results by key. Several processes may read and write one store at the same time."""

    def __init__(self, folder: Path) -> None:
        """Open a store; its folder is made with the first result.

        Raises:
            StoreError: the path exists and is not a folder.
        """
        if folder.exists() and not folder.is_dir():
            raise StoreError(f"store {folder} is not a folder; allowed: a folder or a new path")
        self.folder = folder

    def path_of(self, key: str) -> Path:
        """Return the file of a key, whether it exists or not."""
        return self.folder / f"{key}{_SUFFIX}"

    def keys(self) -> tuple[str, ...]:
        """Return the keys of all files, sound or not, sorted."""
        return tuple(
            path.stem
            for path in self._files()
            if path.suffix == _SUFFIX and _KEY.fullmatch(path.stem)
        )

    def load(self, key: str) -> Run:
        """Load a run and check it.

        Raises:
            StoreError: there is none, or it is damaged.
        """
        path = self.path_of(key)
        if not path.is_file():
            raise StoreError(f"store {self.folder} has no run {key}")
        return read_run(path)

    def find(self, key: str) -> Run | None:
        """Load a run if it is there and sound; a damaged file is reported and put aside."""
        return self._find(key, read_run)

    def save(self, run: Run) -> Path:
        """Store a run as ``save_content`` does; an older result of the same key is replaced."""
        columns = {name: pa.array(values) for name, values in run.trajectory.to_arrays().items()}
        if run.decisions is not None:
            for name, decided in run.decisions.to_arrays().items():
                # The last row of a trajectory ends the trip: nothing is decided there.
                values = pa.array(decided)
                columns[_DECISION_PREFIX + name] = pa.concat_arrays(
                    [values, pa.nulls(1, values.type)]
                )
        content = {
            "spec": run.spec.to_dict(),
            "parameters": to_flat_dict(run.parameters),
            "whole_trip": run.whole_trip,
            "channel": run.channel,
            "reports": [asdict(report) for report in run.reports],
            "record": {name: getattr(run, name) for name in _RECORD},
            # For other readers of the file; here the figures are recomputed.
            "figures": figure_values(run.metrics),
        }
        return self.save_content(run.key, content, columns)

    def find_content(self, key: str) -> tuple[Content, Columns] | None:
        """Load what ``save_content`` stored if it is there and sound; a damaged file is put aside."""
        found = self._find(key, _read)
        if found is None:
            return None
        content, table = found
        return content, {name: table[name].to_numpy() for name in table.column_names}

    def save_content(self, key: str, content: Content, columns: Columns | None = None) -> Path:
        """Store plain values and series of one length, whole or not at all.

        Raises:
            StoreError: the folder cannot be written.
        """
        metadata = canonical_json({"format": FORMAT, "key": key, **content})
        table = pa.table(dict(columns or {}), metadata={_METADATA: metadata})
        table = table.replace_schema_metadata({**table.schema.metadata, _DIGEST: _digest(table)})
        target = self.path_of(key)
        with self._writing():
            temporary = self.folder / f"{_TEMPORARY}{uuid.uuid4().hex}{_SUFFIX}"
            try:
                pq.write_table(table, temporary, compression="zstd", write_page_checksum=True)
                # The content is on the disk before the name is; and as renaming is atomic, another process
                # sees either nothing or the whole result.
                with temporary.open("rb") as file:
                    os.fsync(file.fileno())
                temporary.replace(target)
            finally:
                temporary.unlink(missing_ok=True)
            target.with_suffix(_FAILED).unlink(missing_ok=True)
        return target

    def note_failure(self, key: str, cause: str) -> None:
        """Keep the cause of a failed run until it succeeds."""
        with self._writing():
            self.path_of(key).with_suffix(_FAILED).write_text(cause, encoding="utf-8")

    def failure(self, key: str) -> str:
        """Return the cause of the last failure of a run; empty if there was none."""
        try:
            return self.path_of(key).with_suffix(_FAILED).read_text(encoding="utf-8")
        except (OSError, ValueError):
            return ""

    def prune(self, keep: Collection[str]) -> tuple[str, ...]:
        """Delete all but some results, and what interrupted or damaged runs left; return the names."""
        kept = {self.path_of(key) for key in keep}
        gone = [path for path in self._files() if path not in kept]
        try:
            for path in gone:
                path.unlink()
        except OSError as error:
            raise StoreError(f"store {self.folder} cannot be pruned: {error}") from error
        return tuple(path.name for path in gone)

    def _files(self) -> list[Path]:
        """Everything in the folder that is the store's own, sorted."""
        return [
            path
            for path in (sorted(self.folder.iterdir()) if self.folder.is_dir() else ())
            if path.name.startswith(_TEMPORARY)
            or (path.suffix in {_SUFFIX, _DAMAGED, _FAILED} and _KEY.fullmatch(path.stem))
        ]

    def _find(self, key: str, read: Callable[[Path], Read]) -> Read | None:
        path = self.path_of(key)
        if not path.is_file():
            return None
        try:
            return read(path)
        except StoreError as error:
            LOGGER.warning("%s; it will be recomputed", error)
            with contextlib.suppress(OSError):
                path.replace(path.with_suffix(_DAMAGED))
            return None

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            yield
        except OSError as error:
            raise StoreError(f"store {self.folder} cannot be written: {error}") from error


def default_store_folder() -> Path:
    """Return ``results`` in the repository that the commands of ``scripts/`` enter, else in this folder."""
    root = os.environ.get(ROOT_VARIABLE)
    return (Path(root) if root else Path.cwd()) / DEFAULT_FOLDER


def content_key(*parts: object) -> str:
    """Return the key of a result that is named by plain values."""
    return hashlib.sha256(canonical_json(parts).encode()).hexdigest()[:KEY_LENGTH]


def read_run(path: Path) -> Run:
    """Read a run from a file of a store and check it.

    Raises:
        StoreError: the file is missing, damaged or not of this format.
    """
    return _run(path, *_read(path))


def _read(path: Path) -> tuple[Content, pa.Table]:
    try:
        table = pq.read_table(path, page_checksum_verification=True, memory_map=False)
        metadata = table.schema.metadata or {}
        sound = metadata[_DIGEST] == _digest(table)
        content: Content = json.loads(metadata[_METADATA])
        found = content["format"], content["key"]
    except KeyError as error:
        raise StoreError(
            f"stored run {path.name}: {error} is missing; no result of this format"
        ) from error
    except (OSError, pa.ArrowException, ValueError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise StoreError(f"stored run {path.name}: cannot be read: {reason}") from error
    if not sound:
        raise StoreError(f"stored run {path.name} is damaged: content and digest disagree")
    if found[0] != FORMAT:
        raise StoreError(f"stored run {path.name}: format is {found[0]}; allowed: {FORMAT}")
    if _KEY.fullmatch(path.stem) and found[1] != path.stem:
        raise StoreError(f"stored run {path.name} is the run of another key, {found[1]}")
    return content, table


def _run(path: Path, content: Content, table: pa.Table) -> Run:
    try:
        decisions = None
        if content["whole_trip"] is None:
            decisions = DecisionSeries.from_arrays(
                {
                    name: table[_DECISION_PREFIX + name].drop_null().to_numpy()
                    for name in DECISION_COLUMNS
                }
            )
        return Run(
            key=content["key"],
            spec=RunSpec.from_dict(content["spec"]),
            parameters=flat_to_parameters(content["parameters"], "stored parameters"),
            trajectory=Trajectory.from_arrays(
                {name: table[name].to_numpy() for name in TRAJECTORY_COLUMNS}
            ),
            decisions=decisions,
            whole_trip=content["whole_trip"],
            channel=content["channel"],
            **{name: content["record"][name] for name in _RECORD},
            reports=tuple(Report(**report) for report in content["reports"]),
        )
    except (KeyError, ValueError, TypeError, AttributeError, IptmError) as error:
        raise StoreError(f"stored run {path.name}: {error}; no run of this format") from error


def _digest(table: pa.Table) -> bytes:
    digest = hashlib.sha256(table.schema.metadata[_METADATA])
    digest.update(str(table.schema.remove_metadata()).encode())
    for column in table.columns:
        # What lies under a null is undefined, so only its place counts.
        digest.update(column.is_null().to_numpy().tobytes())
        digest.update(column.drop_null().to_numpy().tobytes())
    return digest.hexdigest().encode()
