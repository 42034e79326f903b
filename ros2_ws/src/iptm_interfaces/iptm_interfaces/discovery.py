"""Find each other fast, and only each other: discovery profile and private domains.

Fast DDS announces a participant a few times at start and then only every three seconds, so that an
announcement lost at start costs seconds. The profile shipped here repeats it twice a second.
"""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from iptm_core.errors import ScenarioError

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable from which Fast DDS 2.14 (Jazzy) reads its profile."""

_DOMAINS = range(1, 102)  # higher ones collide with the ephemeral ports of Linux


def discovery_profile_path() -> Path:
    """Return the path of the Fast DDS profile; give it to processes as `PROFILE_VARIABLE`."""
    return Path(__file__).parent / "data" / "fastdds_discovery.xml"


@contextmanager
def reserve_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other reservation on this machine holds at the same time.

    Two runs in the same domain would hear each other. The reservation is a lock on a file in the
    temporary directory and ends with the context or with the process, however that dies.

    Yields:
        The domain id, to be given to processes as `ROS_DOMAIN_ID`.

    Raises:
        ScenarioError: all domains are taken.
    """
    # Starting at a place of its own keeps one process from reusing a domain that was just left.
    start = os.getpid() % len(_DOMAINS)
    for domain in [*_DOMAINS[start:], *_DOMAINS[:start]]:
        descriptor = _lock(Path(tempfile.gettempdir()) / f"iptm_ros_domain_{domain}.lock")
        if descriptor is None:
            continue
        try:
            yield domain
        finally:
            os.close(descriptor)
        return
    raise ScenarioError(
        f"ROS domains {_DOMAINS[0]} to {_DOMAINS[-1]} are all reserved; allowed: at most "
        f"{len(_DOMAINS)} runs at the same time"
    )


def _lock(path: Path) -> int | None:
    """Return the descriptor of a locked file, or None if someone else holds the lock."""
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except PermissionError:  # left behind by another user
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        return None
    return descriptor
