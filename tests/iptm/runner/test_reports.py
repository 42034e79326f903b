"""What a user sees: tables, progress and picture."""

from __future__ import annotations

import dataclasses
import io
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread
from rich.console import Console
from tests.iptm.runner.conftest import with_metrics

from iptm.run import Run
from iptm.runner import progress as progress_module
from iptm.runner.evaluation import evaluate
from iptm.runner.monitor import Snapshot
from iptm.runner.progress import ConsoleProgress
from iptm.runner.run_folder import RunFolder
from iptm.runner.summary import print_end, print_results, save_picture
from iptm.runner.tables import TABLES_WIDTH
from iptm.trip import Trip
from iptm_core.decision_record import DecisionSeries, Rung
from iptm_core.metrics.figures import FIGURES, TRIP_FIGURES, figure_values
from iptm_core.trajectory import Trajectory
from iptm_ros.recording.run_information import RunInformation
from iptm_ros.topics import Topic

Heard = dict[Topic, list[bytes]]
SNAPSHOT = Snapshot(60.0, 10.0, 34.56, 31.23, 33.21, 2.5e-3, 12, Rung.OPTIMAL)


@pytest.fixture
def results(trip: Trip, heard: Heard) -> Run:
    return evaluate(trip, heard, None, RunInformation(), 0.5)


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    return RunFolder(tmp_path / "short")


def printed(
    results: Run, folder: RunFolder, width: int = TABLES_WIDTH, *, full: bool = False
) -> str:
    console = Console(file=io.StringIO(), width=width)
    print_results(results, console, full=full)
    print_end(results, folder, console)
    return console.file.getvalue()  # type: ignore[attr-defined]


@pytest.mark.parametrize("width", [TABLES_WIDTH, 80])
def test_tables_show_every_figure(results: Run, folder: RunFolder, width: int) -> None:
    text = printed(results, folder, width, full=True)
    values = figure_values(results.metrics)
    for key in TRIP_FIGURES:
        shown = FIGURES[key].label[:20] in text
        assert shown is (not key.startswith("longest_") or values[key] > 0.0), key
    for entry in ("solve time (ms)", "speed-up over real time", "shifted plan", "changed by the"):
        assert entry in text
    assert f"none of {len(results.metrics.constraints)} limits exceeded" in text


def test_a_limit_that_was_exceeded_has_a_row(results: Run, folder: RunFolder) -> None:
    first, *others = results.metrics.constraints
    broken = dataclasses.replace(first, worst_excess=0.5, worst_time_s=7.0, violations=3)
    metrics = dataclasses.replace(results.metrics, constraints=(broken, *others))
    text = printed(with_metrics(results, metrics), folder, full=True)
    assert "0.5 m/s^2" in text
    assert "collision" not in text


@pytest.mark.parametrize("width", [TABLES_WIDTH, 80])
def test_the_result_fits_on_the_last_screen(results: Run, folder: RunFolder, width: int) -> None:
    """Before, 75 lines of tables followed the saving; a terminal has 24."""
    other = dataclasses.replace(results, settings={"strategy": "reference"})
    lines = printed(dataclasses.replace(results, other=other), folder, width).splitlines()
    assert len(lines) < 24
    text = "\n".join(lines)
    for part in (
        "the reference strategy",
        "kWh/100 km",
        "smallest gap",
        str(folder.output),
    ):
        assert part in text
    assert lines[-1] == "trip finished, no hard limit broken, not recorded"


def test_problems_and_warnings_are_printed(results: Run, folder: RunFolder) -> None:
    troubled = dataclasses.replace(
        results,
        problems=("the bag holds 3 messages",),
        warnings=("plant: too [fast]",),
    )
    text = printed(troubled, folder)
    assert "PROBLEM  the bag holds 3 messages" in text
    assert "plant: too [fast]" in text
    assert "trip finished" not in text


def test_a_pipe_gets_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(file=io.StringIO(), width=200)
    progress = ConsoleProgress(console, 240.0)
    progress.waiting("waiting for plant")
    progress.running(SNAPSHOT, 0.2)
    progress.running(SNAPSHOT, 0.3)  # too soon after the line before
    monkeypatch.setattr(progress_module, "LINE_PERIOD_S", 0.0)
    progress.running(dataclasses.replace(SNAPSHOT, rung=Rung.SAFE_LAW), 0.5)
    progress.close()
    first, begun, last = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert first == "starting: waiting for plant"
    assert begun.startswith("60 of 240 s (25%), 300 x real time")
    assert last == (
        "60 of 240 s (25%), 120 x real time, remaining 2 s, speed 36.0 km/h, gap 34.6 m,"
        " cells 31.2/33.2 °C, solve 2.5 ms, 12 iterations, safe law"
    )


def test_a_terminal_gets_a_bar() -> None:
    console = Console(file=io.StringIO(), force_terminal=True, width=120)
    progress = ConsoleProgress(console, 240.0)
    progress.waiting("waiting for plant")
    progress.running(SNAPSHOT, 0.5)
    progress.running(dataclasses.replace(SNAPSHOT, solve_time_s=float("nan")), 0.0)
    progress.close()
    text = console.file.getvalue()  # type: ignore[attr-defined]
    for part in ("waiting for plant", "25%", "60 of 240 s", "2.5 ms", "34.6"):
        assert part in text


def test_the_remaining_time_is_readable() -> None:
    console = Console(file=io.StringIO(), width=200)
    ConsoleProgress(console, 10_000.0).running(SNAPSHOT, 1.0)
    assert "remaining 2:46 min" in console.file.getvalue()  # type: ignore[attr-defined]


def test_the_picture_is_drawn(trip: Trip, results: Run, tmp_path: Path) -> None:
    path = tmp_path / "run.png"
    save_picture(path, results)
    pixels = imread(path)
    assert pixels.shape[1] == 1200
    assert 1000 < pixels.shape[0] < 2000
    # Something is drawn from top to bottom, and it has colours.
    bands = np.array_split(pixels[..., :3], 10, axis=0)
    assert all(float(np.ptp(band)) > 0.5 for band in bands)
    assert float(np.max(np.ptp(pixels[..., :3], axis=2))) > 0.3

    # The curves of the run that it is compared with.
    other = dataclasses.replace(results, settings={"strategy": "reference"})
    save_picture(tmp_path / "compared.png", dataclasses.replace(results, other=other))
    assert not np.array_equal(imread(tmp_path / "compared.png")[: pixels.shape[0]], pixels)

    # A level road needs no panel for its grade.
    level = trip.changed(slope="flat")
    save_picture(path, dataclasses.replace(results, slope=level.route.slope))
    assert imread(path).shape[0] < pixels.shape[0]


def test_interventions_of_the_safety_monitor_are_marked(results: Run, tmp_path: Path) -> None:
    columns = dict(results.trajectory.to_arrays())
    columns["service_braking_s"] = np.zeros_like(columns["time_s"])
    pictures = []
    for name in ("calm.png", "braked.png"):
        run = Trajectory.from_arrays(columns)
        save_picture(tmp_path / name, dataclasses.replace(results, trajectory=run))
        pictures.append(imread(tmp_path / name))
        columns["service_braking_s"] = np.where(columns["time_s"] == 20.0, 0.4, 0.0)
    calm, braked = pictures
    rows = np.flatnonzero(np.any(calm != braked, axis=(1, 2)))
    assert 0 < rows.size < 0.1 * calm.shape[0], "marks and legend of one panel"


def test_a_run_in_which_nothing_happens_can_be_drawn(results: Run, tmp_path: Path) -> None:
    still = {
        name: np.full_like(column, column[0])
        for name, column in results.trajectory.to_arrays().items()
    }
    still["time_s"] = results.trajectory.time_s
    calm = dataclasses.replace(
        results,
        trajectory=Trajectory.from_arrays(still),
        decisions=DecisionSeries.from_records([], []),
    )
    save_picture(tmp_path / "still.png", calm)
    assert (tmp_path / "still.png").stat().st_size > 10_000


def test_curves_of_a_page_can_be_moved_and_hovered(results: Run, tmp_path: Path) -> None:
    pytest.importorskip("plotly", reason="plotly is not installed (requirements/view.txt)")
    text = results.report(tmp_path / "report.html").read_text(encoding="utf-8")
    drawn = text[text.index("Plotly.newPlot(") :]
    titles = [axes.get_title("left") for axes in results.plot().axes]
    places = [drawn.index(f"\\u003cb\\u003e{title}") for title in titles]
    assert places == sorted(places)
    assert drawn.count('"type":"scatter"') > len(titles)
    assert '"hovermode":"x unified"' in drawn
    assert "<script src=" not in text
    assert "<link" not in text


def test_a_page_holds_the_run_and_needs_no_other_file(
    results: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "iptm.interactive", None)
    path = tmp_path / "report.html"
    other = dataclasses.replace(results, settings={"strategy": "reference"})
    results.report(path, other)
    text = path.read_text(encoding="utf-8")
    assert results.name in text
    assert "<td>aging_cost_to_go</td>" in text
    assert 'src="data:image/png;base64,' in text
    assert text.count("src=") == 1
    assert "pip install plotly" in text
    assert "href=" not in text
