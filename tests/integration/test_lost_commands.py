"""A controller that is gone for a while: every output of the run counts the ticks without commands alike."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable
from contextlib import ExitStack, closing, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.integration.conftest import ProcessLauncher, own_domain
from tests.integration.page_browser import Browser

import iptm
from iptm.commands.tree import all_commands
from iptm.faults.kinds import FaultKind
from iptm.trip_files import trip_text
from iptm_bags.reading import info
from iptm_core.state import CommandSource
from iptm_core.units import J_PER_KWH

AWAY = {FaultKind.PROCESS_RESTARTED: (2.5, 1.25), FaultKind.PROCESS_FROZEN: (5.0, 2.0)}
"""Wall time of the absence in s, and rate of the trip: a fast start, too, is late for three ticks.

A slow one has 21 s.
"""


@pytest.fixture(scope="module")
def drives(tmp_path_factory: pytest.TempPathFactory) -> dict[FaultKind, tuple[Path, str]]:
    """Drive with controllers that are away for a while, at the same time, each in a domain of its own.

    A frozen one answers afterwards what it missed, when the vehicle has stopped on its own already.

    Returns:
        Folder of the run and output of the terminal, by fault.
    """
    folder = tmp_path_factory.mktemp("drives")
    with ExitStack() as stack:
        launcher = stack.enter_context(closing(ProcessLauncher(folder, os.environ)))
        started = {}
        for kind, (away_s, rate) in AWAY.items():
            trip = iptm.Trip.of(
                "us06",
                duration_s=40.0,
                horizon="15x1",
                mode="real_time",
                rate_factor=rate,
                command_timeout_s=1.0,
                faults=(iptm.Fault(kind, 10.0, size=away_s, target="controller"),),
            )
            file, output = folder / f"{kind}.yaml", folder / kind
            file.write_text(trip_text(trip), encoding="utf-8")
            options = ("--no-picture", "--against", "none", "--output", output)
            domain = stack.enter_context(own_domain(folder))
            process = launcher.start_module("iptm.commands.run", file, *options, **domain)
            started[kind] = (output, process)
        assert [process.wait(240.0) for _, process in started.values()] == [0, 0]
        return {kind: (output, process.stdout) for kind, (output, process) in started.items()}


@pytest.mark.parametrize("kind", AWAY)
def test_every_output_agrees_on_lost_commands(
    kind: FaultKind,
    drives: dict[FaultKind, tuple[Path, str]],
    launcher: Any,
    wait_until: Callable[..., None],
    tmp_path: Path,
) -> None:
    output, printed = drives[kind]
    run = iptm.load(output)
    figures = run.figures
    lost, held = int(figures["undecided"]), int(figures["held"])
    sources = run.frame["command_source"]
    assert lost == (sources == CommandSource.STOP).sum() >= 1
    assert held == (sources == CommandSource.HELD).sum() >= 1
    assert figures["fallbacks"] >= lost + held
    consumption, margin_m = figures["consumption"], run.metrics.smallest_margin_m

    terminal = " ".join(printed.split())
    assert f"{lost} of them stopped for want of commands" in terminal
    assert f"{consumption:#.3g} kWh/100 km" in terminal
    side = "above" if margin_m >= 0.0 else "below"
    assert f"{abs(margin_m):.2f} m {side} s_min" in terminal

    with redirect_stdout(io.StringIO()) as shown:
        assert info([str(output)]) == 0
    listed = " ".join(shown.getvalue().split())
    assert re.search(rf"Ticks without a decision\W+{lost}\b", listed)
    assert re.search(rf"Battery energy per distance\W+{consumption:#.3g}\b", listed)
    listed_m = re.search(r"Smallest margin to s_min\W+?(-?[\d.]+)", listed)
    assert listed_m is not None
    assert float(listed_m[1]) == pytest.approx(margin_m, abs=0.005)

    report = run.report(tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"{lost} of them stopped for want of commands" in report
    assert f"<td>{consumption:#.3g}</td>" in report

    if "view" not in all_commands():
        return
    process = launcher.start_module(
        "iptm", "view", "--against", "none", "--no-foxglove", str(output), "--rate", "200"
    )
    address = re.compile(r"http://\S+")
    wait_until(lambda: address.search(process.stdout), what="address of the page")
    found = address.search(process.stdout)
    assert found is not None
    browser = Browser(found.group(0))
    wait_until(lambda: browser.has_ended, what="end of the bag")
    names = browser.documents["facts"]["columns"]
    page = np.array(browser.rows, dtype=float).T
    row = {name: page[names.index(name)] for name in names}
    np.testing.assert_array_equal(row["time_s"], run.trajectory.time_s)
    energy_j = float(row["battery_power_w"][1:] @ np.diff(row["time_s"]))
    distance_m = row["position_m"][-1] - row["position_m"][0]
    assert 1e5 * energy_j / J_PER_KWH / distance_m == pytest.approx(consumption)
    assert np.min(row["gap_m"] - row["min_gap_m"]) == pytest.approx(margin_m)
    np.testing.assert_array_equal(row["command_source"], sources)
