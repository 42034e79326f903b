"""Local means local: no process on another host reaches a node, unless its user opens it."""

from __future__ import annotations

import json
import os
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Any

import pytest

from iptm_ros.discovery import PEERS_VARIABLE, PROFILE_VARIABLE, RANGE_VARIABLE
from iptm_ros.topics import Topic

NODE = "iptm_v2x_bridge.node"
UNSET = {PROFILE_VARIABLE: "", RANGE_VARIABLE: "", PEERS_VARIABLE: ""}
"""As in a shell that nothing has prepared."""

# Fast DDS knows a host by 16 bits made of its addresses, and these two have the same: peers with shared
# memory would take each other for processes of one host and send there, in vain, which proves nothing.
CAR_ADDRESS = "198.51.100.81"
HOSTILE_ADDRESS = "198.51.100.239"
NETWORK_ONLY = {"FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}

# Named statically, the car's host is asked for participants. Ends when it has heard enough of the open node.
HOSTILE_PEER = """
import json, time, rclpy
from diagnostic_msgs.msg import DiagnosticArray
rclpy.init()
node = rclpy.create_node("hostile")
heard = []
take = lambda message: heard.extend(status.name for status in message.status)
node.create_subscription(DiagnosticArray, "/diagnostics", take, 10)
deadline = time.monotonic() + 120.0
while sum("open" in name for name in heard) < 4 and time.monotonic() < deadline:
    rclpy.spin_once(node, timeout_sec=0.1)
topics = [name for name, _ in node.get_topic_names_and_types()]
print(json.dumps({"heard": heard, "topics": topics}))
"""


def bound_addresses(process_id: int) -> list[str]:
    """Return the local addresses of all UDP and TCP sockets of a process."""
    process = Path(f"/proc/{process_id}")
    own = set()
    for link in (process / "fd").iterdir():
        with suppress(FileNotFoundError):  # closed in the meantime
            own.add(link.readlink().name.removeprefix("socket:[").removesuffix("]"))
    found = []
    for table in ("udp", "tcp", "udp6", "tcp6"):
        for line in (process / "net" / table).read_text(encoding="ascii").splitlines()[1:]:
            fields = line.split()
            if fields[9] in own:
                words = bytes.fromhex(fields[1].partition(":")[0])
                packed = b"".join(
                    struct.pack(">I", word) for word in struct.unpack(f"={len(words) // 4}I", words)
                )
                found.append(str(ip_address(packed)))
    return found


def test_a_node_has_no_socket_beyond_the_loopback_interface(launcher: Any, peer: Any) -> None:
    """Also where no script has prepared the shell, as under `ros2 run`."""
    process = launcher.start_module(NODE, **UNSET)
    peer.wait_until(lambda: peer.node.count_subscribers(Topic.CLOCK.value), what="the node")
    addresses = bound_addresses(process.popen.pid)
    assert addresses
    assert [address for address in addresses if not ip_address(address).is_loopback] == []


def test_a_node_listens_to_the_network_when_its_user_says_so(
    launcher: Any, wait_until: Callable[..., None]
) -> None:
    process = launcher.start_module(NODE, **{**UNSET, RANGE_VARIABLE: "SUBNET"})
    wait_until(
        lambda: any(
            ip_address(found).is_unspecified for found in bound_addresses(process.popen.pid)
        ),
        what="sockets on all interfaces",
    )


@dataclass(frozen=True)
class TwoHosts:
    """Two network namespaces with a cable between them."""

    car: str
    hostile: str

    def command(self, host: str, *arguments: str) -> list[str]:
        """Return a Python command on one of the hosts."""
        return ["ip", "netns", "exec", host, sys.executable, *arguments]


def ip(*arguments: str) -> str:
    return subprocess.run(["ip", *arguments], check=True, capture_output=True, text=True).stdout


@pytest.fixture
def two_hosts(wait_until: Callable[..., None]) -> Iterator[TwoHosts]:
    if os.geteuid() != 0:
        pytest.skip("only root may make network namespaces")
    if shutil.which("ip") is None:
        pytest.skip("the command `ip` (iproute2) is not installed")
    hosts = TwoHosts(f"iptm_car_{os.getpid()}", f"iptm_hostile_{os.getpid()}")
    made = []
    try:
        try:
            for host in (hosts.car, hosts.hostile):
                ip("netns", "add", host)
                made.append(host)
                ip("-n", host, "link", "set", "lo", "up")
            ends = ["name", "cable", "netns", hosts.car, "type", "veth"]
            ip("link", "add", *ends, "peer", "name", "cable", "netns", hosts.hostile)
            for host, address in ((hosts.car, CAR_ADDRESS), (hosts.hostile, HOSTILE_ADDRESS)):
                ip("-n", host, "addr", "add", f"{address}/24", "dev", "cable")
                ip("-n", host, "link", "set", "cable", "up")
                ip("netns", "exec", host, "true")
        except subprocess.CalledProcessError as error:
            pytest.skip(f"network namespaces are not allowed here: {error.stderr.strip()}")
        for host in made:
            # What starts without a network does not notice one later.
            wait_until(
                lambda host=host: "state UP" in ip("-n", host, "link", "show", "cable"),
                what=f"the cable of {host}",
            )
        yield hosts
    finally:
        for host in made:
            ip("netns", "del", host)


def test_a_peer_on_another_host_reaches_no_node_that_was_not_opened(
    launcher: Any, two_hosts: TwoHosts, wait_until: Callable[..., None]
) -> None:
    def start(name: str, **environment: str) -> Any:
        arguments = ["-m", NODE, "--ros-args", "-r", f"__ns:=/{name}"]
        command = two_hosts.command(two_hosts.car, *arguments)
        return launcher.start(name, *command, **{**UNSET, **environment})

    closed = start("closed")
    wait_until(lambda: bound_addresses(closed.popen.pid), what="sockets of the closed node")
    opened = start("open", **{RANGE_VARIABLE: "SUBNET"})
    command = two_hosts.command(two_hosts.hostile, "-c", HOSTILE_PEER)
    settings = {RANGE_VARIABLE: "SUBNET", PEERS_VARIABLE: CAR_ADDRESS, **NETWORK_ONLY}
    hostile = launcher.start("hostile", *command, **{**UNSET, **settings})
    assert hostile.wait(180.0) == 0
    assert closed.is_running
    assert opened.is_running
    seen = json.loads(hostile.stdout.splitlines()[-1])
    assert "/open/v2x/leader" in seen["topics"]
    assert any("open" in name for name in seen["heard"]), "discovered, but not heard"
    assert [name for name in seen["topics"] + seen["heard"] if "closed" in name] == []
