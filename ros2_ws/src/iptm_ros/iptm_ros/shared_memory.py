"""Removes shared memory that killed processes have left behind.

Fast DDS keeps files ``fastrtps_*`` in ``/dev/shm``: a segment for each participant, and ports at which
messages arrive. The owner holds a lock on ``NAME_el`` (``NAME_sl``, if shared) until it ends. A killed
process leaves its own files and those of others that it used, and whoever opens a dead port waits for its
owner for up to a second.
"""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

FOLDER = Path("/dev/shm")  # noqa: S108  the place is Fast DDS's
_NAME = re.compile(r"(?:sem\.)?(fastrtps_(?:port\d+|[0-9a-f]{16}))(?:_el|_sl|_mutex)?")
_PREFIX = "fastrtps_"
_LOCKS = ("_el", "_sl")


def remove_dead_shared_memory(folder: Path = FOLDER) -> tuple[str, ...]:
    """Remove files of this user that no process holds locked or maps.

    Returns:
        Names of the segments and ports that were removed.
    """
    unlocked = _unlocked(folder)
    unused = unlocked - _used(folder) if unlocked else unlocked
    with ExitStack() as stack:
        dead = [name for name in sorted(unused) if stack.enter_context(_locked(folder, name))]
        # One may have been opened between the two looks; from here on its lock is refused to others.
        used = _used(folder) if dead else set()
        removed = tuple(name for name in dead if name not in used)
        for name in removed:
            for file in (name, f"sem.{name}_mutex", *(name + lock for lock in _LOCKS)):
                (folder / file).unlink(missing_ok=True)
    return removed


@contextmanager
def tidy_shared_memory() -> Iterator[None]:
    """Remove what killed processes have left when the context begins and when it ends."""
    remove_dead_shared_memory()
    try:
        yield
    finally:
        remove_dead_shared_memory()


def _unlocked(folder: Path) -> set[str]:
    """Return the segments and ports of this user whose locks are free."""
    found: dict[str, set[int]] = {}
    user = os.geteuid()
    with suppress(FileNotFoundError), os.scandir(folder) as entries:
        for entry in entries:
            name = _NAME.fullmatch(entry.name)
            with suppress(FileNotFoundError):  # removed by its owner meanwhile
                if name is not None and (status := entry.stat()).st_uid == user:
                    found.setdefault(name[1], set()).add(status.st_ino)
    if not found:
        return set()
    try:
        locks = Path("/proc/locks").read_text(encoding="ascii")
    except OSError:
        return set()
    held = {int(line.split()[-3].rpartition(":")[2]) for line in locks.splitlines()}
    return {name for name, inodes in found.items() if not inodes & held}


def _used(folder: Path) -> set[str]:
    """Return the segments and ports that processes map or, others than this one, have open."""
    paths = set()
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # it has ended, or is another user's
            lines = (process / "maps").read_text(encoding="utf-8", errors="replace").splitlines()
            paths |= {line.split(maxsplit=5)[-1] for line in lines if _PREFIX in line}
            if process.name == str(os.getpid()):
                continue
            for opened in (process / "fd").iterdir():
                with suppress(FileNotFoundError):  # closed meanwhile
                    paths.add(str(opened.readlink()))
    places = (path.rpartition("/") for path in paths)
    names = (_NAME.fullmatch(name) for place, _, name in places if place == str(folder))
    return {name[1] for name in names if name is not None}


@contextmanager
def _locked(folder: Path, name: str) -> Iterator[bool]:
    """Hold the locks of a segment or port; false if another process has one of them."""
    with ExitStack() as stack:
        for path in (folder / (name + lock) for lock in _LOCKS):
            with suppress(FileExistsError):
                path.touch(0o666, exist_ok=False)
                stack.callback(path.unlink, missing_ok=True)
            try:
                descriptor = os.open(path, os.O_RDWR)
                stack.callback(os.close, descriptor)
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                yield False
                return
        yield True
