"""Expected times: they grow with the work, and learn from what runs took."""

from dataclasses import replace

import pytest

from iptm_studies.campaign import ExpectedTimes, modelled_s
from iptm_studies.progress import clock_text
from iptm_studies.run_inputs import resolve_inputs
from iptm_studies.run_spec import RunKind, RunSpec

SPEC = RunSpec(cycle="us06")


def test_more_work_takes_longer() -> None:
    base = modelled_s(SPEC, 1000)
    assert modelled_s(SPEC, 2000) > base
    assert modelled_s(replace(SPEC, horizon="30x1"), 1000) > base
    assert modelled_s(replace(SPEC, kind=RunKind.WHOLE_TRIP), 1000) > base


def test_experience_corrects_each_kind_by_itself() -> None:
    times, inputs = ExpectedTimes(), resolve_inputs(SPEC)
    whole = resolve_inputs(replace(SPEC, kind=RunKind.WHOLE_TRIP))
    assert times.of(inputs) == modelled_s(SPEC, inputs.ticks)
    before = times.of(whole)
    times.learn(SPEC, 1000, 3.0 * modelled_s(SPEC, 1000))
    assert times.of(inputs) == pytest.approx(3.0 * modelled_s(SPEC, inputs.ticks))
    assert times.of(whole) == before


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.4, "0 s"), (89.4, "89 s"), (200.0, "3:20 min"), (5399.0, "89:59 min"), (5460.0, "1:31 h")],
)
def test_clock_text(seconds: float, text: str) -> None:
    assert clock_text(seconds) == text
