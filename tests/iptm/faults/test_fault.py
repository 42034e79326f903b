"""Faults as data: permitted entries, refusals, and the ticks that are hit."""

from __future__ import annotations

import pytest

from iptm.faults.fault import Fault, faults_from, plain_faults
from iptm.faults.injection import check_headless
from iptm.faults.kinds import FaultKind
from iptm_core.errors import ParameterError, ScenarioError

NS = 10**9


def test_a_list_of_a_file_is_read_in_order_and_written_back() -> None:
    entries = [
        {"kind": "process_restarted", "start_s": 200, "target": "plant"},
        {"kind": "leader_hard_stop", "start_s": 120, "duration_s": 15, "size": 6},
        {"kind": "preview_lost", "start_s": 60.0, "probability": 0.5, "seed": 3},
    ]
    faults = faults_from(entries, "trip.yaml")
    assert [fault.start_s for fault in faults] == [60.0, 120.0, 200.0]
    assert faults[1].magnitude == 6.0
    assert faults[2].target == "plant"
    assert faults_from(plain_faults(faults), "again") == faults


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"kind": "preview_lots"}, "allowed: leader_cut_in"),
        ({"kind": "preview_lost", "starts": 1}, "did you mean 'start_s'?"),
        ({"start_s": 1}, "'kind' is missing"),
        ({"kind": "preview_lost", "start_s": -1}, "start_s is -1"),
        ({"kind": "preview_lost", "start_s": float("nan")}, "start_s is nan"),
        ({"kind": "preview_lost", "probability": 1.5}, "probability is 1.5"),
        ({"kind": "preview_lost", "size": 3}, "size is 3; allowed: none"),
        ({"kind": "leader_cut_in", "size": -3}, "size is -3; allowed: 0.5 to 200 m"),
        ({"kind": "preview_lost", "target": "plant"}, "target is 'plant'; allowed: none"),
        ({"kind": "process_killed", "target": "driver"}, "allowed: one of , plant"),
        ("preview_lost", "allowed: a mapping"),
    ],
)
def test_refusals_name_file_place_and_what_is_allowed(entry: object, message: str) -> None:
    with pytest.raises(ScenarioError, match=r"trip\.yaml: fault 1") as refused:
        faults_from([entry], "trip.yaml")
    assert message in str(refused.value)


def test_a_list_is_needed() -> None:
    with pytest.raises(ScenarioError, match="faults is 'x'; allowed: a list"):
        faults_from("x", "trip.yaml")


@pytest.mark.parametrize("kind", FaultKind)
def test_every_kind_can_be_stated_by_its_name_alone(kind: FaultKind) -> None:
    (fault,) = faults_from([{"kind": kind.value}], "trip.yaml")
    assert fault.kind is kind
    assert kind.spec.meaning


def test_a_fault_lasts_from_its_start_to_before_its_end() -> None:
    fault = Fault(FaultKind.PREVIEW_LOST, start_s=10.0, duration_s=5.0)
    hit = [second for second in range(30) if fault.hits(second * NS)]
    assert hit == [10, 11, 12, 13, 14]


def test_chance_is_that_of_seed_and_tick() -> None:
    fault = Fault(FaultKind.PREVIEW_LOST, 0.0, 4000.0, 0.3, seed=1)
    hit = [fault.hits(second * NS) for second in range(4000)]
    assert hit == [fault.hits(second * NS) for second in range(4000)]
    assert 0.27 < sum(hit) / 4000 < 0.33
    other = Fault(FaultKind.PREVIEW_LOST, 0.0, 4000.0, 0.3, seed=2)
    assert hit != [other.hits(second * NS) for second in range(4000)]


def test_what_needs_ros_is_refused_without() -> None:
    with pytest.raises(ScenarioError, match="process_killed"):
        check_headless([Fault(FaultKind.PROCESS_KILLED)])


def test_a_fault_of_a_program_is_checked_as_that_of_a_file() -> None:
    with pytest.raises(ParameterError, match="probability"):
        Fault(probability=2.0)
