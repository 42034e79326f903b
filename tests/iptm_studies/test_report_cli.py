"""The command of the reproduction: the studies, and then the report."""

from collections.abc import Callable
from pathlib import Path

import pytest

from iptm_studies.campaign import Campaign
from iptm_studies.cli import EXIT_FAILED_RUNS, EXIT_REFUSED
from iptm_studies.report import cli as report_cli
from iptm_studies.store import ResultStore

GOOD = """
title: Good
defaults: {cycle: us06, duration_s: 5, horizon: 3x1+5x5}
cases: [{name: aging}]
"""


@pytest.mark.usefixtures("at_once")
def test_without_a_command_it_computes_and_reports(
    study_file: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    seen: list[tuple[ResultStore, Campaign, Path]] = []

    def build(store: ResultStore, campaign: Campaign, output: Path) -> tuple[Path, ...]:
        seen.append((store, campaign, output))
        return (output / "page.html",)

    monkeypatch.setattr(report_cli, "build_report", build)
    folder, page = tmp_path / "kept", tmp_path / "page"
    options = ["--store", str(folder), "--output", str(page)]
    assert report_cli.main([*options, "--", str(study_file(GOOD))]) == 0
    ((store, campaign, output),) = seen
    assert [state.reason for state in campaign.cases] == [""]
    assert (store.folder, output) == (folder, page)
    assert "report: " in capsys.readouterr().err
    # The report is written all the same when a run failed, and the exit code tells.
    failing = str(study_file())
    assert report_cli.main(["reproduce", failing, "--store", str(folder)]) == EXIT_FAILED_RUNS
    assert len(seen) == 2


def test_no_results_no_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert report_cli.main(["report", "strategies", "--store", str(tmp_path)]) == EXIT_REFUSED
    assert "error: " in capsys.readouterr().err
