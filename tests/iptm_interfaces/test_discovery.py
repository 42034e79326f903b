from __future__ import annotations

import os
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from iptm_core.errors import ScenarioError
from iptm_interfaces import discovery
from iptm_interfaces.discovery import discovery_profile_path, reserve_domain

NAMESPACE = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"


@pytest.fixture(autouse=True)
def _own_temporary_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


def test_profile_is_the_default_and_announces_twice_a_second() -> None:
    root = ET.parse(discovery_profile_path()).getroot()  # noqa: S314  our own file
    participant = root.find(f".//{NAMESPACE}participant")
    assert participant is not None
    assert participant.get("is_default_profile") == "true"
    path = "/".join(
        NAMESPACE + tag for tag in ("rtps", "builtin", "discovery_config", "leaseAnnouncement")
    )
    announcement = participant.find(path)
    assert announcement is not None
    assert [child.text for child in announcement] == ["0", "500000000"]


def test_reservations_at_the_same_time_differ() -> None:
    with reserve_domain() as first, reserve_domain() as second, reserve_domain() as third:
        assert len({first, second, third}) == 3
        assert all(1 <= domain <= 101 for domain in (first, second, third))


def test_reservation_ends_with_its_context() -> None:
    with reserve_domain() as first:
        pass
    with reserve_domain() as second:
        assert second == first


def test_locked_and_unusable_files_are_passed_over(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "getpid", lambda: 0)
    with reserve_domain() as first:
        assert first == 1
        real_open = os.open

        def refuse_second(path: Path, *arguments: int) -> int:
            if path.name == "iptm_ros_domain_2.lock":
                raise PermissionError(path)
            return real_open(path, *arguments)

        monkeypatch.setattr(os, "open", refuse_second)
        with reserve_domain() as other:
            assert other == 3


def test_no_domain_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "_DOMAINS", range(1, 2))
    with (
        reserve_domain(),
        pytest.raises(ScenarioError, match="all reserved"),
        reserve_domain(),
    ):
        pass
