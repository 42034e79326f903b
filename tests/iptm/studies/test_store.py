"""The store: whole runs or none, found again, and damage noticed."""

import json
import logging
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from iptm.studies.run import Run
from iptm.studies.store import ResultStore, content_key, default_store_folder
from iptm.studies.study import Case
from iptm.whole_trip import WholeTripRecord, WholeTripSolve
from iptm_core.errors import StoreError

MakeRun = Callable[..., Run]


@pytest.fixture
def run(made_run: Run) -> Run:
    return made_run


def assert_same(found: Run, run: Run) -> None:
    for name in set(vars(run)) - {"trajectory", "decisions", "metrics"}:
        assert getattr(found, name) == getattr(run, name), name
    for name, values in run.trajectory.to_arrays().items():
        np.testing.assert_array_equal(getattr(found.trajectory, name), values)
    if run.decisions is None:
        assert found.decisions is None
        return
    for name, before in vars(run.decisions).items():
        after = getattr(found.decisions, name)
        assert after.dtype == before.dtype
        np.testing.assert_array_equal(after, before)


def test_a_run_comes_back_bit_by_bit(store: ResultStore, run: Run) -> None:
    assert store.find(run.key) is None
    path = store.save(run)
    assert store.keys() == (run.key,)
    assert [entry.name for entry in store.folder.iterdir()] == [path.name]
    assert_same(store.load(run.key), run)
    # As text: since Python 3.13 data with the same NaN is not equal.
    assert repr(store.load(run.key).metrics) == repr(run.metrics)


def test_a_whole_trip_has_no_log(store: ResultStore, run: Run) -> None:
    solve = WholeTripSolve(
        status="numerical_error",
        iterations=3,
        time_s=1.5,
        objective=None,
        infeasibility=0.25,
        moved_m=12.0,
    )
    record = WholeTripRecord(
        settled=False,
        solves=[solve, solve],
        gap_slack_m=0.0,
        speed_slack_m_s=0.5,
        temperature_slack_k=0.0,
        costate_times_s=[9.0, 19.0],
        cell_1_costates_1_k=[1.5, 0.0],
        cell_n_costates_1_k=[4.5, 0.0],
    )
    whole = replace(run, decisions=None, whole_trip=record)
    store.save(whole)
    found = store.load(run.key)
    assert_same(found, whole)
    assert found.metrics.decisions is None


def test_other_tools_read_the_file(store: ResultStore, run: Run) -> None:
    table = pq.read_table(store.save(run))
    assert table.num_rows == len(run.trajectory)
    assert table["speed_m_s"].to_pylist() == [10.0] * table.num_rows
    assert table["decision_status"].to_pylist() == [0, 0, 1, -1, 2, None]
    figures = json.loads(table.schema.metadata[b"iptm"])["figures"]
    assert figures["cell_1_degradation"] == pytest.approx(1e5 * 5e-9)


def test_saving_again_replaces(store: ResultStore, make_run: MakeRun, short_inputs: Case) -> None:
    store.save(make_run(short_inputs))
    worse = make_run(short_inputs, 2.0)
    store.save(worse)
    assert len(store.keys()) == 1
    assert_same(store.load(worse.key), worse)


def test_what_is_not_there(store: ResultStore) -> None:
    assert store.keys() == ()
    assert store.prune(()) == ()
    with pytest.raises(StoreError, match="has no run 1234"):
        store.load("1234")


@pytest.mark.parametrize("cut", [0.0, 0.01, 0.5, 0.99])
def test_a_cut_file_is_damaged(
    store: ResultStore, run: Run, cut: float, caplog: pytest.LogCaptureFixture
) -> None:
    path = store.save(run)
    content = path.read_bytes()
    path.write_bytes(content[: int(cut * len(content))])
    with pytest.raises(StoreError, match="cannot be read"):
        store.load(run.key)
    with caplog.at_level(logging.WARNING):
        assert store.find(run.key) is None
    assert "recomputed" in caplog.text
    assert store.keys() == (), "the damaged file is put aside"
    assert path.with_suffix(".damaged").exists()
    store.save(run)
    assert_same(store.load(run.key), run)


def test_no_flipped_bit_goes_unnoticed(store: ResultStore, run: Run) -> None:
    """Every damage is found, or does not affect the content."""
    path = store.save(run)
    content = path.read_bytes()
    numbers = np.random.default_rng(1)
    for _ in range(400):
        damaged = bytearray(content)
        damaged[numbers.integers(len(content))] ^= 1 << int(numbers.integers(8))
        path.write_bytes(bytes(damaged))
        try:
            found = store.load(run.key)
        except StoreError:
            continue
        assert_same(found, run)


def test_foreign_and_misnamed_files(store: ResultStore, run: Run) -> None:
    path = store.save(run)
    other = store.path_of("0" * len(run.key))
    other.write_bytes(path.read_bytes())
    with pytest.raises(StoreError, match="run of another key"):
        store.load(other.stem)
    table = pq.read_table(path)
    pq.write_table(table.replace_schema_metadata({}), other)
    with pytest.raises(StoreError, match="no result of this format"):
        store.load(other.stem)
    row = table.column_names.index("speed_m_s")
    pq.write_table(table.set_column(row, "speed_m_s", [[11.0] * table.num_rows]), path)
    with pytest.raises(StoreError, match="digest disagree"):
        store.load(run.key)
    store.save(run)
    other.write_text("hello", encoding="utf-8")
    (store.folder / "notes.txt").write_text("mine", encoding="utf-8")
    assert store.find(other.stem) is None
    assert store.keys() == (run.key,)


def test_an_interrupted_save_leaves_nothing(
    store: ResultStore, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(table: object, path: Path, **_: object) -> None:
        del table
        path.write_bytes(b"PAR1 half a file")
        raise KeyboardInterrupt

    monkeypatch.setattr(pq, "write_table", interrupted)
    with pytest.raises(KeyboardInterrupt):
        store.save(run)
    assert list(store.folder.iterdir()) == []


def test_a_store_that_cannot_be_written(tmp_path: Path, run: Run) -> None:
    taken = tmp_path / "file"
    taken.write_text("x", encoding="utf-8")
    with pytest.raises(StoreError, match="is not a folder"):
        ResultStore(taken)
    with pytest.raises(StoreError, match="cannot be written"):
        ResultStore(taken / "below").save(run)


def test_concurrent_writers_and_readers(store: ResultStore, run: Run) -> None:
    store.save(run)
    errors: list[Exception] = []

    def write() -> None:
        for _ in range(20):
            store.save(run)

    def read() -> None:
        try:
            for _ in range(20):
                store.load(run.key)
        except StoreError as error:
            errors.append(error)

    threads = [threading.Thread(target=target) for target in (write, write, read, read)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert errors == []
    assert [entry.name for entry in store.folder.iterdir()] == [store.path_of(run.key).name]


def test_causes_of_failures_are_kept_until_success(store: ResultStore, run: Run) -> None:
    assert store.failure(run.key) == ""
    store.note_failure(run.key, "no luck")
    assert store.failure(run.key) == "no luck"
    assert store.keys() == ()
    store.save(run)
    assert store.failure(run.key) == ""


def test_prune_keeps_what_is_needed_and_what_is_not_ours(store: ResultStore, run: Run) -> None:
    store.save(run)
    gone = store.path_of("f" * len(run.key))
    gone.write_bytes(b"old")
    gone.with_suffix(".damaged").write_bytes(b"old")
    store.note_failure("e" * len(run.key), "old")
    (store.folder / ".unfinished-1.parquet").write_bytes(b"old")
    mine = store.folder / "my_table.parquet"
    mine.write_bytes(b"mine")
    assert store.keys() == (run.key, gone.stem)
    assert len(store.prune([run.key])) == 4
    assert sorted(store.folder.iterdir()) == sorted([store.path_of(run.key), mine])


def test_plain_values_and_series_come_back(store: ResultStore) -> None:
    key = content_key("braking", 3)
    assert store.find_content(key) is None
    store.save_content(key, {"pairs": [["b", 1], ["a", 2]]}, {"gap_m": np.array([1.5, 0.1])})
    found = store.find_content(key)
    assert found is not None
    assert found[0]["pairs"] == [["b", 1], ["a", 2]]
    assert found[1]["gap_m"].tolist() == [1.5, 0.1]
    store.save_content(key, {})
    with pytest.raises(StoreError, match="no run of this format"):
        store.load(key)


def test_default_folder(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("IPTM_ROOT", str(tmp_path))
    assert default_store_folder() == tmp_path / "results"
    monkeypatch.delenv("IPTM_ROOT")
    monkeypatch.chdir(tmp_path)
    assert default_store_folder() == tmp_path / "results"
