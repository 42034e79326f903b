"""The files of a bag: which they are, and how each is opened."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any

from iptm_core.errors import BagError
from iptm_core.user_input import shown
from iptm_ros.recording.mcap_storage import McapStorage
from iptm_ros.recording.ros1_storage import Ros1Storage
from iptm_ros.recording.sqlite_storage import SqliteStorage
from iptm_ros.recording.storage import StorageFile
from iptm_ros.recording.unpacking import unpack_file

_OPENERS: Mapping[str, Callable[[Path, Path | None], StorageFile]] = MappingProxyType(
    {".mcap": McapStorage, ".db3": SqliteStorage, ".bag": Ros1Storage}
)
_STORAGES = ("mcap", "sqlite3")
_PACKED = ".zstd"
_MODES = ("", "none", "file", "message")


def open_files(path: Path, metadata: Mapping[str, Any]) -> list[StorageFile]:
    """Open the files of a bag, in recording order.

    Raises:
        BagError: the bag does not exist, has another storage format, or a file is damaged.
    """
    with ExitStack() as stack:
        opened = [stack.enter_context(closing(open_file(file))) for file in _files(path, metadata)]
        stack.pop_all()
    return opened


def open_file(path: Path) -> StorageFile:
    """Open one file of a bag; what is packed with zstd is unpacked into the folder for temporary files."""
    if path.suffix != _PACKED:
        return _opener(path)(path, None)
    try:
        with TemporaryDirectory(prefix="iptm_bag_") as folder:
            plain = Path(folder) / path.stem
            unpack_file(path, plain)
            # An open file outlives its name: nothing stays behind, however the process ends.
            return _opener(plain)(plain, path)
    except OSError as error:
        raise BagError(f"cannot unpack {path}: {error}") from None


def check_exists(path: Path) -> None:
    """Refuse a bag that is not there."""
    try:
        exists = path.exists()
    except OSError as error:
        raise BagError(f"bag {shown(str(path))}: {error.strerror}") from None
    if not exists:
        raise BagError(f"{path} does not exist")


def _opener(path: Path) -> Callable[[Path, Path | None], StorageFile]:
    return _OPENERS.get(path.suffix, McapStorage)


def _files(path: Path, metadata: Mapping[str, Any]) -> list[Path]:
    if path.is_file():
        return [path]
    if metadata:
        return _listed_files(path, metadata)
    if any(path.glob("*.mcap")):
        raise BagError(
            f"{path} has no metadata.yaml: its recording was cut short;"
            f" repair it with: scripts/recover_bag {path}"
        )
    others = sorted(
        file for ending in ("*.db3", "*.bag", f"*{_PACKED}") for file in path.glob(ending)
    )
    if others:
        raise BagError(f"{path} has no metadata.yaml; name its file {others[0]} itself")
    raise BagError(f"{path} is not a bag: it holds neither metadata.yaml nor an .mcap file")


def _listed_files(folder: Path, metadata: Mapping[str, Any]) -> list[Path]:
    storage = metadata.get("storage_identifier")
    if storage not in _STORAGES:
        raise BagError(f"{folder} is stored as {shown(storage)}; allowed: {', '.join(_STORAGES)}")
    mode, packing = (metadata.get(f"compression_{key}") or "" for key in ("mode", "format"))
    if str(mode).lower() not in _MODES:
        raise BagError(f"compression_mode of {folder} is {shown(mode)}; allowed: FILE, MESSAGE")
    if str(mode).lower() not in _MODES[:2] and packing != "zstd":
        raise BagError(f"compression_format of {folder} is {shown(packing)}; allowed: zstd")
    names = metadata.get("relative_file_paths")
    if not isinstance(names, list) or not names:
        raise BagError(f"{folder / 'metadata.yaml'} names no file in relative_file_paths")
    files = [folder / Path(str(name)).name for name in names]
    if len(set(files)) < len(files):
        raise BagError(f"{folder / 'metadata.yaml'} names a file twice in relative_file_paths")
    for file in files:
        if not file.is_file():
            raise BagError(f"{file} is missing, though metadata.yaml of its bag names it")
    return files
