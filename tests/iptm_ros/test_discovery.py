"""ROS domains that are free, and the settings of the middleware."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from iptm_core.errors import ScenarioError
from iptm_ros import discovery
from iptm_ros.discovery import (
    PROFILE_VARIABLE,
    check_nodes_can_meet,
    middleware_settings,
    reserve_domain,
    without_shared_memory,
)

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PEERS = "ROS_STATIC_PEERS"
NAMESPACE = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"


@pytest.fixture(autouse=True)
def _own_reservations(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave the domains of other runs on this machine alone."""
    monkeypatch.setattr(discovery, "_NAME", f"\0iptm_test_{os.getpid()}")


@pytest.mark.parametrize("opened", ["", "SUBNET"])
def test_profile_is_the_default_and_announces_twice_a_second(opened: str) -> None:
    profile = middleware_settings({RANGE: opened})[PROFILE_VARIABLE]
    root = ET.parse(profile).getroot()  # noqa: S314  our own file
    participant = root.find(f".//{NAMESPACE}participant")
    assert participant is not None
    assert participant.get("is_default_profile") == "true"
    path = "/".join(
        NAMESPACE + tag for tag in ("rtps", "builtin", "discovery_config", "leaseAnnouncement")
    )
    announcement = participant.find(path)
    assert announcement is not None
    assert [child.text for child in announcement] == ["0", "500000000"]


@pytest.mark.parametrize(
    "environment",
    [{}, {RANGE: ""}, {RANGE: "LOCALHOST"}, {"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}],
)
def test_without_other_wishes_a_process_is_local(environment: dict[str, str]) -> None:
    """The range that ROS calls local would open sockets on all interfaces beside the profile."""
    settings = middleware_settings(environment)
    assert Path(settings[PROFILE_VARIABLE]).name == "fastdds_local.xml"
    assert settings[RANGE] == "SYSTEM_DEFAULT"
    assert middleware_settings({**environment, **settings}) == {}


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({RANGE: "SUBNET"}, {PROFILE_VARIABLE: "fastdds_discovery.xml"}),
        ({RANGE: "LOCALHOST", PEERS: "10.0.0.7"}, {PROFILE_VARIABLE: "fastdds_discovery.xml"}),
        ({PEERS: "10.0.0.7"}, {PROFILE_VARIABLE: "fastdds_discovery.xml", RANGE: "LOCALHOST"}),
        ({PROFILE_VARIABLE: "mine.xml"}, {RANGE: "LOCALHOST"}),
        ({PROFILE_VARIABLE: "mine.xml", RANGE: "SUBNET"}, {}),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, {RANGE: "LOCALHOST"}),
    ],
)
def test_what_the_user_has_set_is_kept(
    environment: dict[str, str], expected: dict[str, str]
) -> None:
    settings = middleware_settings(environment)
    assert {name: Path(value).name for name, value in settings.items()} == expected


def test_reservations_at_the_same_time_differ() -> None:
    with reserve_domain() as first, reserve_domain() as second, reserve_domain() as third:
        assert len({first, second, third}) == 3
        assert all(1 <= domain <= 101 for domain in (first, second, third))


def test_reservation_ends_with_its_context() -> None:
    with reserve_domain() as first:
        pass
    with reserve_domain() as second:
        assert second == first


def test_domains_of_other_processes_are_passed_over() -> None:
    with reserve_domain() as first:
        code = (
            "from iptm_ros import discovery\n"
            f"discovery._NAME = {discovery._NAME!r}\n"
            f"discovery._DOMAINS = range({first}, {first} + 2)\n"
            "with discovery.reserve_domain() as other: print(other)"
        )
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
    assert done.stdout.split() == [str(first + 1)]


def test_no_file_is_opened_in_a_folder_of_everybody(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Other users may put links into the temporary folder; they must not be followed."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    for domain in range(1, 102):
        (tmp_path / f"iptm_ros_domain_{domain}.lock").symlink_to(tmp_path / "precious")
    with reserve_domain():
        assert not (tmp_path / "precious").exists()


def test_no_domain_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "_DOMAINS", range(1, 2))
    with (
        reserve_domain(),
        pytest.raises(ScenarioError, match="all reserved"),
        reserve_domain(),
    ):
        pass


def test_an_environment_in_which_nodes_cannot_meet_is_refused_at_once(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as server:
        server.bind(("127.0.0.1", 0))
        alive = f"127.0.0.1:{server.getsockname()[1]}"
        check_nodes_can_meet({"ROS_DISCOVERY_SERVER": f";{alive}", RANGE: "SUBNET"})
        server.close()
        refusals = (
            ({"ROS_DISCOVERY_SERVER": alive}, "where no server is"),
            ({RANGE: "OFF"}, "allowed: LOCALHOST, SUBNET"),
            ({"ROS_SECURITY_ENABLE": "true"}, "ROS_SECURITY_KEYSTORE is ''"),
        )
        for environment, reason in refusals:
            with pytest.raises(ScenarioError, match=reason):
                check_nodes_can_meet(environment)
    keys = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_KEYSTORE": str(tmp_path)}
    check_nodes_can_meet(keys)
    check_nodes_can_meet({})


def test_a_node_keeps_off_shared_memory(tmp_path: Path) -> None:
    """As a process: the threads of Fast DDS say over what it listens."""
    code = (
        "import rclpy, pathlib; rclpy.init(); node = rclpy.create_node('quiet');"
        "print([each.read_text() for each in pathlib.Path('/proc/self/task').glob('*/comm')])"
    )
    heard = {}
    for name, settings in {
        "local": middleware_settings({}),
        "udp": without_shared_memory(tmp_path),
    }.items():
        environment = {**os.environ, **settings, "ROS_DOMAIN_ID": "87"}
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
        heard[name] = ["dds.shm" in done.stdout, "dds.udp" in done.stdout]
    assert heard == {"local": [True, True], "udp": [False, True]}
