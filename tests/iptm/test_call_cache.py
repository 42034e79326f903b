"""Calls in processes and on a cluster: what is finished is kept, what dies takes nothing else with it."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.iptm.called import crash, note_and_square, noted

import iptm
from iptm.call_cache import DIED, cached_calls
from iptm.fingerprint import call_key
from iptm_core.errors import ParameterError


def calls_of(folder: Path, count: int, **more: float) -> list[dict[str, object]]:
    return [{"number": number, "notes": folder / "notes", **more} for number in range(count)]


def values_of(outcomes: object) -> list[object]:
    return [one.value for one in sorted(outcomes, key=lambda one: one.index)]


@pytest.mark.parametrize("workers", [1, 2])
def test_finished_calls_are_not_computed_again(tmp_path: Path, workers: int) -> None:
    first = calls_of(tmp_path, 3)
    outcomes = cached_calls(note_and_square, first, workers=workers, cache=tmp_path / "cache")
    assert values_of(outcomes) == [0, 1, 4]
    again = list(cached_calls(note_and_square, calls_of(tmp_path, 5), cache=tmp_path / "cache"))
    assert values_of(again) == [0, 1, 4, 9, 16]
    assert [one.cached for one in again] == [True] * 3 + [False] * 2
    assert noted(tmp_path / "notes") == Counter(range(5))


def test_an_interruption_keeps_what_was_finished(tmp_path: Path) -> None:
    running = cached_calls(note_and_square, calls_of(tmp_path, 4), cache=tmp_path / "cache")
    assert [next(running).value, next(running).value] == [0, 1]
    running.close()
    assert values_of(cached_calls(note_and_square, calls_of(tmp_path, 4), cache=tmp_path / "cache"))
    assert noted(tmp_path / "notes") == Counter(range(4))


def test_outcomes_come_as_they_are_finished(tmp_path: Path) -> None:
    slow_first = [
        {"number": 1, "notes": tmp_path / "notes", "last_s": 1.0},
        {"number": 2, "notes": tmp_path / "notes"},
    ]
    with ThreadPoolExecutor(2) as pool:
        order = [one.index for one in cached_calls(note_and_square, slow_first, executor=pool)]
    assert order == [1, 0]


def test_a_damaged_value_is_computed_again(tmp_path: Path) -> None:
    calls = calls_of(tmp_path, 1)
    list(cached_calls(note_and_square, calls, cache=tmp_path / "cache"))
    (file,) = (tmp_path / "cache").iterdir()
    file.write_bytes(file.read_bytes()[:-3])
    (outcome,) = cached_calls(note_and_square, calls, cache=tmp_path / "cache")
    assert (outcome.value, outcome.cached) == (0, False)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_failure_is_an_outcome_and_is_tried_again(tmp_path: Path, workers: int) -> None:
    calls = [{"number": "x", "notes": tmp_path / "notes"}, *calls_of(tmp_path, 2)]
    for _ in range(2):
        outcomes = cached_calls(note_and_square, calls, workers=workers, cache=tmp_path / "cache")
        failed, *others = sorted(outcomes, key=lambda one: one.index)
        assert failed.failure.startswith("TypeError: ")
        assert [one.value for one in others] == [0, 1]


def test_a_process_that_dies_fails_its_own_call_only(tmp_path: Path) -> None:
    calls = [*calls_of(tmp_path, 3), {"number": crash, "notes": tmp_path / "notes"}]
    outcomes = cached_calls(note_and_square, calls, workers=2, cache=tmp_path / "cache")
    *others, died = sorted(outcomes, key=lambda one: one.index)
    assert died.failure == DIED
    assert [one.value for one in others] == [0, 1, 4]


def test_keys_differ_where_results_may(tmp_path: Path) -> None:
    file = tmp_path / "drive.csv"
    file.write_text("time_s,speed_m_s\n0,0\n")
    arguments = [
        {"cycle": "us06"},
        {"cycle": "nycc"},
        {"cycle": str(file)},
        {"cycle": "us06", "overrides": {"body.mass_kg": 1500.0}},
        {"cycle": np.array([1.0, 2.0])},
        {"cycle": np.array([1.0, 3.0])},
        {"cycle": pd.DataFrame({"time_s": [0.0, 1.0]})},
        {"cycle": pd.DataFrame({"time_s": [0.0, 2.0]})},
        {"strategy": iptm.STRATEGIES["aging"]},
        {"strategy": iptm.STRATEGIES["reference"]},
    ]
    keys = [call_key(iptm.simulate, each) for each in arguments]
    assert len({*keys}) == len(keys)
    assert [call_key(iptm.simulate, each) for each in arguments] == keys
    file.write_text("time_s,speed_m_s\n0,0\n1,0\n")
    assert call_key(iptm.simulate, arguments[2]) != keys[2]


def test_what_cannot_be_described_is_refused() -> None:
    with pytest.raises(ParameterError, match="can be pickled"):
        call_key(iptm.simulate, {"controller": sys.stdout})


def test_a_sweep_over_processes_equals_one_in_this_process_and_resumes(tmp_path: Path) -> None:
    axes = {"cycle": "nycc", "duration_s": 4.0, "horizon": ["3x1", "4x1"]}
    plain = iptm.sweep(**axes)
    parallel = iptm.sweep(**axes, workers=2, cache=tmp_path)
    assert_same_figures(plain, parallel)
    files = {file: file.stat().st_mtime_ns for file in tmp_path.iterdir()}
    assert len(files) == 2
    assert_same_figures(plain, iptm.sweep(**axes, cache=tmp_path))
    assert {file: file.stat().st_mtime_ns for file in tmp_path.iterdir()} == files


def assert_same_figures(one: iptm.Sweep, other: iptm.Sweep) -> None:
    """Times of the solver aside, which are those of the machine."""
    tables = [sweep.table.filter(regex="^(?!solve_)") for sweep in (one, other)]
    pd.testing.assert_frame_equal(*tables)


@pytest.mark.integration
def test_a_cluster_that_loses_a_worker_gives_the_same_and_repeats_nothing_finished(
    tmp_path: Path,
) -> None:
    distributed = pytest.importorskip("distributed")
    count = 12
    calls = calls_of(tmp_path, count, last_s=0.4)
    with distributed.LocalCluster(
        n_workers=0, dashboard_address=None, protocol="tcp", host="127.0.0.1"
    ) as cluster:
        address = cluster.scheduler_address
        command = [sys.executable, "-m", "distributed.cli.dask_worker", address]
        command += ["--no-nanny", "--nthreads", "1", "--no-dashboard"]
        workers = [
            subprocess.Popen([*command, "--local-directory", str(tmp_path / str(number))])
            for number in range(2)
        ]
        try:
            with distributed.Client(address) as client:
                client.wait_for_workers(2, timeout=120)
                executor = client.get_executor()
                running = cached_calls(
                    note_and_square, calls, executor=executor, cache=tmp_path / "cache"
                )
                first = [next(running) for _ in range(count // 2)]
                kept = {one.index for one in first}
                workers[0].send_signal(signal.SIGKILL)
                outcomes = [*first, *running]
        finally:
            for worker in workers:
                worker.kill()
                worker.wait()
    assert values_of(outcomes) == [number**2 for number in range(count)]
    times = noted(tmp_path / "notes")
    assert {number: times[number] for number in kept} == dict.fromkeys(kept, 1)
    # Only what the killed worker had in hand, or had not handed over yet, is computed once more.
    assert sum(times.values()) <= count + 2
    assert values_of(cached_calls(note_and_square, calls, cache=tmp_path / "cache")) == values_of(
        outcomes
    )
    assert noted(tmp_path / "notes") == times
