"""The store of finished runs: a folder with one Parquet file per key."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import re
import uuid
from collections.abc import Collection, Iterator
from pathlib import Path

from iptm_core.errors import StoreError
from iptm_studies.run_inputs import KEY_LENGTH
from iptm_studies.run_spec import RunSpec
from iptm_studies.store_file import read_run, write_run
from iptm_studies.stored_run import StoredRun

LOGGER = logging.getLogger(__name__)
DEFAULT_FOLDER = "results"
ROOT_VARIABLE = "IPTM_ROOT"
_SUFFIX = ".parquet"
_DAMAGED = ".damaged"
_FAILED = ".failed"
_TEMPORARY = ".unfinished-"
_KEY = re.compile(rf"[0-9a-f]{{{KEY_LENGTH}}}")


class ResultStore:
    """Finished runs by key. Several processes may read and write one store at the same time."""

    def __init__(self, folder: Path) -> None:
        """Open a store; its folder is made with the first run.

        Raises:
            StoreError: the path is taken by something that is no folder.
        """
        if folder.exists() and not folder.is_dir():
            raise StoreError(f"store {folder} is not a folder; allowed is a folder or a new path")
        self.folder = folder

    def path_of(self, key: str) -> Path:
        """File of a key, whether it exists or not."""
        return self.folder / f"{key}{_SUFFIX}"

    def keys(self) -> tuple[str, ...]:
        """Keys of all files, sound or not, sorted."""
        if not self.folder.is_dir():
            return ()
        return tuple(
            sorted(
                path.stem
                for path in self.folder.iterdir()
                if path.suffix == _SUFFIX and _KEY.fullmatch(path.stem)
            )
        )

    def __contains__(self, key: object) -> bool:
        """True if there is a file for the key; whether it is sound shows when it is loaded."""
        return isinstance(key, str) and self.path_of(key).is_file()

    def load(self, key: str) -> StoredRun:
        """Load a run and check it.

        Raises:
            StoreError: there is none, or it is damaged.
        """
        path = self.path_of(key)
        if not path.is_file():
            raise StoreError(f"store {self.folder} has no run {key}")
        run = read_run(path)
        if run.key != key:
            raise StoreError(f"stored run {path.name} is the run of another key, {run.key}")
        return run

    def find(self, key: str) -> StoredRun | None:
        """Load a run if it is there and sound; a damaged file is reported and put aside."""
        if key not in self:
            return None
        try:
            return self.load(key)
        except StoreError as error:
            LOGGER.warning("%s; it will be computed anew", error)
            with contextlib.suppress(OSError):
                path = self.path_of(key)
                path.replace(path.with_suffix(_DAMAGED))
            return None

    def save(self, run: StoredRun) -> Path:
        """Store a run, whole or not at all; an older result of the same key is replaced.

        Raises:
            StoreError: the folder cannot be written.
        """
        target = self.path_of(run.key)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            temporary = self.folder / f"{_TEMPORARY}{uuid.uuid4().hex}{_SUFFIX}"
            try:
                write_run(temporary, run)
                _flush(temporary)
                # Renaming is atomic: another process sees either nothing or the whole run.
                temporary.replace(target)
            finally:
                temporary.unlink(missing_ok=True)
            self._failure_path(run.key).unlink(missing_ok=True)
        except OSError as error:
            raise StoreError(f"store {self.folder} cannot be written: {error}") from error
        return target

    def note_failure(self, key: str, spec: RunSpec, cause: str) -> None:
        """Keep the cause of a failed run until it succeeds.

        Raises:
            StoreError: the folder cannot be written.
        """
        text = json.dumps({"cause": cause, "spec": spec.to_dict()}, indent=1)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._failure_path(key).write_text(text, encoding="utf-8")
        except OSError as error:
            raise StoreError(f"store {self.folder} cannot be written: {error}") from error

    def failure(self, key: str) -> str:
        """Cause of the last failure of a run; empty if there was none."""
        try:
            return str(json.loads(self._failure_path(key).read_text(encoding="utf-8"))["cause"])
        except (OSError, ValueError, KeyError, TypeError):
            return ""

    def _failure_path(self, key: str) -> Path:
        return self.folder / f"{key}{_FAILED}"

    def runs(self) -> Iterator[StoredRun]:
        """All sound runs, one after the other; damaged files are reported and put aside."""
        for key in self.keys():
            run = self.find(key)
            if run is not None:
                yield run

    def prune(self, keep: Collection[str]) -> tuple[str, ...]:
        """Delete every run but those to keep, and what interrupted or damaged runs left.

        Returns:
            Names of the deleted files.

        Raises:
            StoreError: a file cannot be deleted.
        """
        if not self.folder.is_dir():
            return ()
        kept = {self.path_of(key).name for key in keep}
        gone = [
            path
            for path in sorted(self.folder.iterdir())
            if path.name not in kept
            and (
                path.name.startswith(_TEMPORARY)
                or (path.suffix in {_SUFFIX, _DAMAGED, _FAILED} and _KEY.fullmatch(path.stem))
            )
        ]
        try:
            for path in gone:
                path.unlink()
        except OSError as error:
            raise StoreError(f"store {self.folder} cannot be pruned: {error}") from error
        return tuple(path.name for path in gone)


def default_store_folder() -> Path:
    """``results`` in the repository that the commands of ``scripts/`` enter, else in this folder."""
    root = os.environ.get(ROOT_VARIABLE)
    return (Path(root) if root else Path.cwd()) / DEFAULT_FOLDER


def _flush(path: Path) -> None:
    """Make sure that the content is on the disk before the name is."""
    with path.open("rb") as file:
        os.fsync(file.fileno())
