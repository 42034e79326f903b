"""The command behind scripts/reproduce: the studies' commands, and the report after them."""

from pathlib import Path

import pytest

import iptm_reproduction.report
from iptm.studies.campaign import Campaign
from iptm.studies.cli import EXIT_FAILED_RUNS
from iptm.studies.store import ResultStore
from iptm_core.program import EXIT_USER_ERROR
from iptm_reproduction import cli
from iptm_reproduction.report import build_report

Reports = list[tuple[Path, Path, list[str]]]


@pytest.fixture
def reports(monkeypatch: pytest.MonkeyPatch) -> Reports:
    """What reports were asked for: store, output folder, names of the studies."""
    seen: Reports = []

    def build(store: ResultStore, campaign: Campaign, output: Path) -> tuple[Path, ...]:
        seen.append((store.folder, output, [study.name for study in campaign.studies]))
        return (output / "page.html",)

    monkeypatch.setattr(iptm_reproduction.report, "build_report", build)
    return seen


@pytest.mark.parametrize("code", [0, EXIT_FAILED_RUNS])
def test_without_a_command_it_computes_and_reports(
    code: int,
    reports: Reports,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The report is written all the same when a run failed, with a nonzero exit code."""
    monkeypatch.setattr(cli, "run_studies", lambda _options, _console: code)
    store, output = tmp_path / "kept", tmp_path / "page"
    given = ["--store", str(store), "--output", str(output), "--", "whole_trip"]
    assert cli.main(given) == code
    assert reports == [(store, output, ["whole_trip"])]
    assert f"report: {output / 'page.html'}" in capsys.readouterr().err


def test_dry_runs_write_no_report(
    reports: Reports, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["--dry-run", "--small", "--store", str(tmp_path)]) == 0
    assert "runs to compute" in capsys.readouterr().out
    assert reports == []


def test_report_alone(reports: Reports, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["report", "whole_trip", "--store", str(tmp_path)]) == 0
    assert reports == [(tmp_path, tmp_path / "report", ["whole_trip"])]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(iptm_reproduction.report, "build_report", build_report)
        assert cli.main(["report", "strategies", "--store", str(tmp_path)]) == EXIT_USER_ERROR
    assert "error: " in capsys.readouterr().err


@pytest.mark.parametrize(
    "command", ["reproduce", "run", "report", "list", "status", "tables", "prune"]
)
def test_every_command_has_its_help(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        cli.main([command, "--help"])
    assert stopped.value.code == 0
    assert f"reproduce {command}" in capsys.readouterr().out
