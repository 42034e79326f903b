"""Find each other fast, and only each other: discovery profile and private domains.

Fast DDS announces a participant a few times at start and then only every three seconds, so that an
announcement lost at start costs seconds. The profile shipped here repeats it twice a second.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from iptm_core.errors import ScenarioError

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable from which Fast DDS 2.14 (Jazzy) reads its profile."""

_NAME = "\0iptm_ros_domain"  # the null character makes it abstract (Linux)
_DOMAINS = range(1, 102)  # higher ones collide with the ephemeral ports of Linux


def discovery_profile_path() -> Path:
    """Return the path of the Fast DDS profile; give it to processes as `PROFILE_VARIABLE`."""
    return Path(__file__).parent / "data" / "fastdds_discovery.xml"


@contextmanager
def reserve_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other reservation on this machine holds at the same time.

    Two runs in the same domain would hear each other. The reservation is an abstract socket: it reaches
    as far as the loopback device over which the runs would hear each other, is no file that anybody
    could put a link in the place of, and ends with the context or with the process, however that dies.

    Yields:
        The domain id, to be given to processes as `ROS_DOMAIN_ID`.

    Raises:
        ScenarioError: all domains are taken.
    """
    # Starting at a place of its own keeps one process from reusing a domain that was just left.
    start = os.getpid() % len(_DOMAINS)
    for domain in [*_DOMAINS[start:], *_DOMAINS[:start]]:
        reservation = _reserved(domain)
        if reservation is None:
            continue
        with reservation:
            yield domain
        return
    raise ScenarioError(
        f"ROS domains {_DOMAINS[0]} to {_DOMAINS[-1]} are all reserved; allowed: at most "
        f"{len(_DOMAINS)} runs at the same time"
    )


def _reserved(domain: int) -> socket.socket | None:
    """Return what holds a reservation, or None if someone else has it."""
    reservation = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        reservation.bind(f"{_NAME}_{domain}")
    except OSError:
        reservation.close()
        return None
    return reservation
