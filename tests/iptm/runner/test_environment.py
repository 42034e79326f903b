"""Which domain and environment the processes of a run get."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from iptm.runner.supervisor import (
    RunDomain,
    domain_of_run,
    environment_of_run,
    process_environment,
)
from iptm.trip_settings import AUTOMATIC_DOMAIN
from iptm_core.errors import ScenarioError
from iptm_ros.discovery import PROFILE_VARIABLE, middleware_settings


@pytest.mark.parametrize(("asked", "number"), [(142, 142), (AUTOMATIC_DOMAIN, 147)])
def test_the_users_choice_of_a_domain_is_respected(asked: int, number: int) -> None:
    with domain_of_run(asked, environment={"ROS_DOMAIN_ID": "147"}) as domain:
        assert domain == RunDomain(number, is_private=False)


def test_runs_at_the_same_time_get_different_domains() -> None:
    with (
        domain_of_run(AUTOMATIC_DOMAIN, environment={}) as one,
        domain_of_run(AUTOMATIC_DOMAIN, environment={}) as other,
    ):
        assert one.is_private
        assert one.number != other.number


def test_a_domain_has_one_run_of_a_namespace_and_its_process_is_named() -> None:
    """Whether the first run chose the domain or was given it."""
    with domain_of_run(AUTOMATIC_DOMAIN, environment={}) as first:
        with (
            pytest.raises(ScenarioError, match=rf"in use by process {os.getpid()} \("),
            domain_of_run(first.number),
        ):
            pass
        with domain_of_run(first.number, "/car_1"):
            pass
    with domain_of_run(first.number):
        pass


@pytest.mark.parametrize("text", ["abc", "-1", "233", "1.5"])
def test_a_senseless_domain_is_refused(text: str) -> None:
    with (
        pytest.raises(ScenarioError, match=r"ROS_DOMAIN_ID.*allowed: 0 to 232"),
        domain_of_run(AUTOMATIC_DOMAIN, environment={"ROS_DOMAIN_ID": text}),
    ):
        pass


def test_what_the_user_has_set_is_kept(tmp_path: Path) -> None:
    mine = {
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        PROFILE_VARIABLE: "/my/profile.xml",
        "OMP_NUM_THREADS": "4",
        "AMENT_PREFIX_PATH": "/opt/ros/jazzy",
        "HOME": "/home",
    }
    found = environment_of_run(5, tmp_path, mine)
    assert found.items() >= mine.items()
    assert found["ROS_DOMAIN_ID"] == "5"
    assert found["ROS_LOG_DIR"] == str(tmp_path)


def test_what_is_not_set_gets_a_sensible_value(tmp_path: Path) -> None:
    found = environment_of_run(5, tmp_path, {PROFILE_VARIABLE: ""})
    assert found.items() >= middleware_settings({}).items()
    assert found["OMP_NUM_THREADS"] == "1"
    assert found["AMENT_PREFIX_PATH"] == sys.prefix


def test_the_environment_of_this_process_changes_for_the_run_only(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", "/mine")
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    before = dict(os.environ)
    with process_environment(environment_of_run(5, tmp_path)):
        assert os.environ["ROS_DOMAIN_ID"] == "5"
        assert os.environ["ROS_LOG_DIR"] == str(tmp_path)
    assert dict(os.environ) == before
