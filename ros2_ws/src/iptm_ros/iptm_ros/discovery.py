"""Discovery limited to this machine: profiles of the middleware and private domains.

Fast DDS announces a participant a few times at start and then only every three seconds, so that an
announcement lost at start costs seconds. The profiles shipped here repeat it twice a second.

``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` keeps a node from looking for peers elsewhere, but not a peer
elsewhere from reaching it: it listens on all interfaces, and a peer that lists this host in its
``ROS_STATIC_PEERS`` connects. The local profile binds every socket to the loopback interface.
"""

from __future__ import annotations

import os
import re
import socket
import struct
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from iptm_core.errors import ScenarioError
from iptm_ros.shared_memory import tidy_shared_memory

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable from which Fast DDS 2.14 (Jazzy) reads its profile."""
RANGE_VARIABLE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PEERS_VARIABLE = "ROS_STATIC_PEERS"
MIDDLEWARE_VARIABLE = "RMW_IMPLEMENTATION"
FAST_DDS = "fastrtps"
SERVER_VARIABLE = "ROS_DISCOVERY_SERVER"
SECURITY_VARIABLES = ("ROS_SECURITY_ENABLE", "ROS_SECURITY_KEYSTORE")
_SERVER = re.compile(r"(?:UDPv[46]:)?\[?([^\s\[\]]+?)\]?(?::(\d+))?")
_SERVER_PORT = 11811
_SERVER_ANSWERS_S = 0.3
LOCALHOST = "LOCALHOST"
OFF = "OFF"
AS_PROFILE_SAYS = "SYSTEM_DEFAULT"
"""Range with which ROS adds nothing to the profile, see ``data/fastdds_local.xml``."""

_DATA = Path(__file__).parent / "data"
LOCAL_PROFILE = "fastdds_local.xml"
_PROFILES_NAMESPACE = "http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"
_NAME = "\0iptm_ros_domain"  # the null character makes it abstract (Linux)
_CREDENTIALS = struct.Struct("3i")  # struct ucred of unix(7): pid, uid, gid
_LONGEST_COMMAND = 100
_DOMAINS = range(1, 102)  # higher ones collide with the ephemeral ports of Linux


def check_nodes_can_meet(environment: Mapping[str, str] = os.environ) -> None:
    """Refuse an environment in which the nodes of a run cannot find each other.

    Raises:
        ScenarioError: discovery is off, its server is not there, or security is on without keys.
    """
    if environment.get(RANGE_VARIABLE, "").upper() == OFF:
        raise ScenarioError(
            f"{RANGE_VARIABLE} is {OFF}: the nodes of a run cannot find each other; allowed: LOCALHOST, "
            "SUBNET"
        )
    for server in filter(None, environment.get(SERVER_VARIABLE, "").split(";")):
        if _is_dead(server.strip()):
            raise ScenarioError(
                f"{SERVER_VARIABLE} is {server!r}, where no server is: the nodes of a run cannot find each "
                "other; allowed: a running server, or no such variable"
            )
    enable, store = (environment.get(name, "") for name in SECURITY_VARIABLES)
    if enable.lower() == "true" and not Path(store or "none").is_dir():
        raise ScenarioError(
            f"{SECURITY_VARIABLES[0]} is {enable}, {SECURITY_VARIABLES[1]} is {store!r}; allowed: the folder "
            "of keys with it, or security off"
        )


def _is_dead(server: str) -> bool:
    """Return whether a host refuses datagrams to a server; one that is silent may be alive."""
    address = _SERVER.fullmatch(server)
    if address is None:
        return False
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.settimeout(_SERVER_ANSWERS_S)
            sender.connect((address[1], int(address[2] or _SERVER_PORT)))
            sender.send(b"RTPS")
            sender.recv(1)
    except TimeoutError:
        return False
    except OSError:
        return True
    return False


def middleware_settings(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Return what a process of the suite sets before it takes part in the graph.

    Without other wishes it talks on this machine only. A range beyond `LOCALHOST`, or peers named,
    open it to the network; a profile of the user's own is left alone.

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
            PROFILE_VARIABLE: str(_DATA / LOCAL_PROFILE),
        }
    return {PROFILE_VARIABLE: str(_DATA / "fastdds_discovery.xml"), **default_range}


def without_shared_memory(folder: Path) -> dict[str, str]:
    """Write the local profile without shared memory to a folder; return the variables that select it.

    A process that is stopped for seconds does not empty its queue in shared memory. Others take the queue for
    dead then, and the process no longer hears them after it goes on. ``FASTDDS_BUILTIN_TRANSPORTS`` does not
    count beside a profile with transports of its own.
    """
    profile = ET.parse(_DATA / LOCAL_PROFILE)  # noqa: S314 - own file
    for transports in profile.findall(".//{*}userTransports"):
        for transport in transports.findall("{*}transport_id"):
            if transport.text == "iptm_shared_memory":
                transports.remove(transport)
    return _selected(profile, folder / "fastdds_udp.xml")


def for_vehicles(count: int, folder: Path, environment: Mapping[str, str]) -> dict[str, str]:
    """Write the local profile for several vehicles in a process; return the variables that select it.

    Messages of a tick, and its time, grow with the vehicles: so do queues in shared memory, and the time
    after which publishers ask for acknowledgements. At that of one vehicle, the questions of hundreds of
    publishers, each repeated until it is answered, keep a busy machine from anything else.

    Args:
        count: vehicles of the string.
        folder: for the profile.
        environment: with the settings of the middleware; another profile than the local one is left alone.
    """
    if environment.get(PROFILE_VARIABLE) != str(_DATA / LOCAL_PROFILE):
        return {}
    profile = ET.parse(_DATA / LOCAL_PROFILE)  # noqa: S314 - own file
    for name in ("segment_size", "port_queue_capacity", "heartbeatPeriod/{*}nanosec"):
        for element in profile.findall(f".//{{*}}{name}"):
            element.text = str(count * int(element.text or 0))
    return _selected(profile, folder / "fastdds_string.xml")


def _selected(profile: ET.ElementTree[Any], path: Path) -> dict[str, str]:
    ET.register_namespace("", _PROFILES_NAMESPACE)
    profile.write(path, encoding="utf-8", xml_declaration=True)
    return {RANGE_VARIABLE: AS_PROFILE_SAYS, PROFILE_VARIABLE: str(path)}


@contextmanager
def reserve_domain() -> Iterator[int]:
    """Reserve a ROS domain that no other reservation on this machine holds at the same time.

    Two runs in the same domain would receive each other's messages. The reservation is an abstract socket: it
    reaches as far as the loopback device over which the runs communicate, is not a file that another user can
    replace by a link, and ends with the context or the process.

    Yields:
        The domain id, to be given to processes as `ROS_DOMAIN_ID`.
    """
    # Starting at a place of its own keeps one process from reusing a domain that was just left.
    start = os.getpid() % len(_DOMAINS)
    for domain in [*_DOMAINS[start:], *_DOMAINS[:start]]:
        reservation = _reserved(domain)
        if reservation is None:
            continue
        with reservation, tidy_shared_memory():
            yield domain
        return
    raise ScenarioError(
        f"ROS domains {_DOMAINS[0]} to {_DOMAINS[-1]} are all reserved; allowed: at most "
        f"{len(_DOMAINS)} runs at the same time"
    )


@contextmanager
def lock_run(domain: int, namespace: str) -> Iterator[None]:
    """Hold the right to drive a run in a namespace of a ROS domain, first come, first served.

    The lock is an abstract socket, as in `reserve_domain`, which passes over the domain meanwhile.

    Raises:
        ScenarioError: another run holds it; the message names its process.
    """
    name = f"{_NAME}_{domain}_run{namespace}"
    with ExitStack() as stack:
        lock = _bound(name)
        if lock is None:
            place = f"ROS domain {domain}" + (f", {namespace}," if namespace != "/" else "")
            raise ScenarioError(
                f"{place} is in use by {_holder(name)}; allowed: one run per domain (see --domain)"
            )
        stack.enter_context(lock)
        reservation = _reserved(domain)  # none where the caller's parent has reserved the domain
        if reservation is not None:
            stack.enter_context(reservation)
        stack.enter_context(tidy_shared_memory())
        yield


def _reserved(domain: int) -> socket.socket | None:
    """Return what holds a reservation, or None if someone else has it."""
    return _bound(f"{_NAME}_{domain}")


def _bound(name: str) -> socket.socket | None:
    """Return a socket that listens at a name, so that others can find its owner; None if it is taken."""
    bound = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        bound.bind(name)
        bound.listen()
    except OSError:
        bound.close()
        return None
    return bound


def _holder(name: str) -> str:
    """Return the process that listens at a name, in words."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
            asking.settimeout(1.0)
            asking.connect(name)
            owner = asking.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        pid, _, _ = _CREDENTIALS.unpack(owner)
        words = Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return "another process"
    command = " ".join(words[words.index("-m") + 1 :] if "-m" in words else words).strip()
    return f"process {pid} ({command[:_LONGEST_COMMAND]})"
