"""The files of a bag: which they are."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from iptm_core.errors import BagError
from iptm_core.user_input import shown
from iptm_ros.recording.mcap_storage import CONVERT, BagFile

_OTHERS = ("*.db3", "*.bag", "*.zstd")


def open_files(path: Path, metadata: Mapping[str, Any]) -> list[BagFile]:
    """Open the files of a bag, in recording order.

    Raises:
        BagError: the bag does not exist, is of another kind, or a file is damaged.
    """
    with ExitStack() as stack:
        opened = [stack.enter_context(closing(BagFile(file))) for file in _files(path, metadata)]
        stack.pop_all()
    return opened


def check_exists(path: Path) -> None:
    """Refuse a bag that is not there."""
    try:
        exists = path.exists()
    except OSError as error:
        raise BagError(f"bag {shown(str(path))}: {error.strerror}") from None
    if not exists:
        raise BagError(f"{path} does not exist")


def _files(path: Path, metadata: Mapping[str, Any]) -> list[Path]:
    if path.is_file():
        return [path]
    if metadata:
        return _listed_files(path, metadata)
    if any(path.glob("*.mcap")):
        raise BagError(
            f"{path} has no metadata.yaml: its recording was cut short;"
            f" repair it with: scripts/iptm recover {path}"
        )
    others = sorted(file for ending in _OTHERS for file in path.glob(ending))
    if others:
        raise BagError(CONVERT.format(path=path, source=others[0]))
    raise BagError(f"{path} is not a bag: it holds neither metadata.yaml nor an .mcap file")


def _listed_files(folder: Path, metadata: Mapping[str, Any]) -> list[Path]:
    is_packed = str(metadata.get("compression_mode") or "none").lower() != "none"
    if metadata.get("storage_identifier") != "mcap" or is_packed:
        raise BagError(CONVERT.format(path=folder, source=folder))
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
