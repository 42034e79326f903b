"""What a bag keeps about its run: parameters, versions, settings."""

from __future__ import annotations

import platform
import re
import subprocess
from pathlib import Path

import pytest

from iptm_core.errors import BagError
from iptm_core.parameters import load_parameters, to_flat_dict
from iptm_ros.recording.bag_reader import read_model_parameters
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.run_information import (
    UNKNOWN,
    RunInformation,
    collect_run_information,
    git_revision,
    load_run_information,
    stored_model_parameters,
    versions,
)


def test_custom_data_and_back() -> None:
    information = RunInformation("s", 3, "a: 1\n", "abc", {"x": "1"}, "now", {"more": "text"})
    assert RunInformation.from_custom_data(information.to_custom_data()) == information
    assert RunInformation.from_custom_data({}) == RunInformation()


def test_collected_information_is_complete() -> None:
    information = collect_run_information(scenario="s", seed=1, parameters={"a": [1, 2.5]})
    assert information.parameters == "a:\n- 1\n- 2.5\n"
    assert information.started_at_utc.endswith("+00:00")
    assert {"python", "platform", "numpy", "mcap"} <= set(information.versions)


def test_file_of_the_runner(tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text("scenario: wltc\nseed: 4\nparameters: {model: {a: 1}}\nstrategy: J1\n")
    information = load_run_information(path)
    assert (information.scenario, information.seed) == ("wltc", 4)
    assert information.parameters == "model:\n  a: 1\n"
    assert information.extra == {"strategy": "J1"}
    assert information.versions["python"]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("- 1", "allowed: a mapping"),
        ("{", "not valid YAML"),
        ("seed: many", "seed is 'many'"),
        ("seed: true", "seed is True"),
        ("parameters: [1]", "parameters are a list"),
    ],
)
def test_malformed_file_of_the_runner(text: str, reason: str, tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text(text)
    with pytest.raises(BagError, match=reason):
        load_run_information(path)


def test_missing_file_of_the_runner(tmp_path: Path) -> None:
    with pytest.raises(BagError, match="no such file"):
        load_run_information(tmp_path / "no.yaml")


def test_model_parameters_come_back_bit_by_bit(tmp_path: Path) -> None:
    parameters = load_parameters(overrides={"gap.max_gap_m": 80.1}).values
    information = collect_run_information(parameters={"model": to_flat_dict(parameters)})
    with BagWriter(tmp_path / "bag", custom_data=information.to_custom_data()):
        pass
    assert read_model_parameters(tmp_path / "bag") == (parameters, True)


def test_bag_without_model_parameters_is_judged_by_the_default_set(small_bag: Path) -> None:
    assert read_model_parameters(small_bag) == (load_parameters().values, False)
    assert stored_model_parameters(RunInformation(parameters="a: 1")) is None


@pytest.mark.parametrize("text", ["{", "model: 3", "model: {gap.max_gap_m: 1}"])
def test_malformed_model_parameters(text: str) -> None:
    with pytest.raises(BagError):
        stored_model_parameters(RunInformation(parameters=text))


def test_references_that_multiply_are_refused(tmp_path: Path) -> None:
    """Ten lines stand for ten billion values; written out they would fill the memory."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 10)]
    path = tmp_path / "bomb.yaml"
    path.write_text("\n".join(lines))
    with pytest.raises(BagError, match="more than 200000 values, references counted"):
        load_run_information(path)


def test_revision_of_a_work_tree_and_of_a_changed_one(tmp_path: Path) -> None:
    def git(*arguments: str) -> None:
        identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
        subprocess.run(["git", *identity, *arguments], cwd=tmp_path, check=True)

    (tmp_path / "file").write_text("1", encoding="utf-8")
    git("init", "-q")
    git("add", "file")
    git("commit", "-qm", "first")
    assert re.fullmatch("[0-9a-f]{40}", git_revision(tmp_path))
    (tmp_path / "file").write_text("2", encoding="utf-8")
    git_revision.cache_clear()
    assert re.fullmatch("[0-9a-f]{40}-dirty", git_revision(tmp_path))


def test_outside_git_and_without_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert git_revision(tmp_path) == UNKNOWN
    monkeypatch.setenv("PATH", str(tmp_path))
    assert git_revision(tmp_path / "other") == UNKNOWN


def test_versions_of_what_is_installed() -> None:
    found = versions(["numpy", "no-such-package"])
    assert found["python"] == platform.python_version()
    assert found["numpy"]
    assert "no-such-package" not in found
