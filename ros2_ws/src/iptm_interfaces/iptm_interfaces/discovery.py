"""Find each other fast, on this machine, and nobody else: profiles of the middleware and private domains.

Fast DDS announces a participant a few times at start and then only every three seconds, so that an
announcement lost at start costs seconds. The profiles shipped here repeat it twice a second.

``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` keeps a node from looking for peers elsewhere, but not a peer
elsewhere from reaching it: it listens on all interfaces, and whoever names the host in its
``ROS_STATIC_PEERS`` takes part. The local profile binds every socket to the loopback interface.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from iptm_core.errors import ScenarioError

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable from which Fast DDS 2.14 (Jazzy) reads its profile."""
RANGE_VARIABLE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PEERS_VARIABLE = "ROS_STATIC_PEERS"
MIDDLEWARE_VARIABLE = "RMW_IMPLEMENTATION"
FAST_DDS = "fastrtps"
LOCALHOST = "LOCALHOST"
AS_PROFILE_SAYS = "SYSTEM_DEFAULT"
"""Range with which ROS adds nothing to the profile, see ``data/fastdds_local.xml``."""

_DATA = Path(__file__).parent / "data"
_NAME = "\0iptm_ros_domain"  # the null character makes it abstract (Linux)
_DOMAINS = range(1, 102)  # higher ones collide with the ephemeral ports of Linux


def middleware_settings(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return what a process of the suite sets before it takes part in the graph.

    Without other wishes it talks on this machine only. A range beyond `LOCALHOST`, or peers named,
    open it to the network; a profile of the user's own is left alone.

    Args:
        environment: what the user has set; an empty value counts as not set.

    Returns:
        Variables to set; reading them again from an environment that has them changes nothing.
    """
    given_range = environment.get(RANGE_VARIABLE, "")
    default_range = {} if given_range else {RANGE_VARIABLE: LOCALHOST}
    middleware = environment.get(MIDDLEWARE_VARIABLE) or FAST_DDS
    if environment.get(PROFILE_VARIABLE) or FAST_DDS not in middleware:
        return default_range
    if given_range in ("", LOCALHOST) and not environment.get(PEERS_VARIABLE):
        return {
            RANGE_VARIABLE: AS_PROFILE_SAYS,
            PROFILE_VARIABLE: str(_DATA / "fastdds_local.xml"),
        }
    return {PROFILE_VARIABLE: str(_DATA / "fastdds_discovery.xml"), **default_range}


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
