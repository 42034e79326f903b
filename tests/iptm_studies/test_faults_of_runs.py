"""Faults in run specifications and in the campaign of random cars."""

from __future__ import annotations

import pytest

from iptm_core.errors import ScenarioError
from iptm_faults.fault import Fault
from iptm_faults.kinds import FaultKind
from iptm_studies.random_cars.draws import random_study
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.run_spec import RunSpec

STOP = Fault(FaultKind.LEADER_HARD_STOP, 30.0, 10.0)
LOST = Fault(FaultKind.PREVIEW_LOST, 10.0, 10.0)


def test_faults_are_part_of_a_specification_and_of_its_key() -> None:
    sound, faulty = RunSpec(duration_s=60.0), RunSpec(duration_s=60.0, faults=(STOP, LOST))
    assert faulty.faults == (LOST, STOP)
    assert RunSpec.from_dict(faulty.to_dict()) == faulty
    assert resolve_inputs(sound).key != resolve_inputs(faulty).key
    assert "leader_hard_stop 8 m/s^2 at 30 s for 10 s" in faulty.describe()


def test_a_fault_that_needs_ros_is_refused() -> None:
    with pytest.raises(ScenarioError, match="clock_jump"):
        RunSpec(faults=(Fault(FaultKind.CLOCK_JUMP),))


def test_a_share_of_the_runs_has_faults_and_the_cars_stay_as_they_are() -> None:
    none, some, all_of_them = (
        random_study(20, 5, with_twins=False, fault_share=share).cases for share in (0.0, 0.3, 1.0)
    )
    assert not any(case.spec.faults for case in none)
    assert 1 < sum(bool(case.spec.faults) for case in some) < 12
    assert all(case.spec.faults for case in all_of_them)
    assert [case.spec.overrides for case in none] == [case.spec.overrides for case in all_of_them]
    kinds = {fault.kind for case in all_of_them for fault in case.spec.faults}
    assert len(kinds) > 12


def test_a_share_is_one() -> None:
    with pytest.raises(ScenarioError, match=r"fault share is 1\.5; allowed: 0 to 1"):
        random_study(1, 1, fault_share=1.5)
