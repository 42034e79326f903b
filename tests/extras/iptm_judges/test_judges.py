"""Judges from outside of the suite: against its own laws, on made and driven trips, and refusals."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import iptm
from iptm import judging
from iptm.judging import OTHER, SAVED, judge
from iptm_core.aging_laws.judging import CELL_JUDGES, Exposure

main = import_module("iptm_judges.cli").main

TIME_S = np.arange(0.0, 1801.0)
SAME_CELLS = {
    "NCA": "NCA (Panasonic)",
    "NMC811-Si": "NMC811-SiGr (LG MJ1)",
    "NMC111": "NMC111 (Kokam)",
    "NMC111 (18650)": "NMC111 (Sanyo)",
    "NMC622": "NMC622 (DENSO)",
    "LFP": "LFP (250 Ah)",
}
"""Cells of the suite by their names there."""
Runs = tuple[iptm.Run, iptm.Run]


def parked(kelvin: float) -> Exposure:
    return Exposure(TIME_S, np.full(TIME_S.size, 0.9), np.full(TIME_S.size, kelvin))


def failing(cell: str, exposure: Exposure) -> float:
    raise iptm.IptmError(f"law {cell}: {exposure.time_s.size} rows")


def foreign(library: str, module: str) -> dict[str, Any]:
    pytest.importorskip(library)
    return {each.name: each for each in import_module(f"iptm_judges.{module}").judges()}


@pytest.fixture(scope="module")
def runs() -> Runs:
    """A trip of ten minutes by two controls without an optimisation."""
    own, other = (
        iptm.simulate("us06", strategy=name, preview_mode="none")
        for name in ("eco_acc", "production")
    )
    return own, other


def test_the_laws_of_the_suite_save_what_blast_lite_saves(runs: Runs) -> None:
    """Losses within 10 %, savings of each cell within 2.5 points, medians on the same side."""
    pytest.importorskip("blast")
    found = judge(*runs, by=("cells", "blast")).table
    own, theirs = found.loc["laws of cells"], found.loc["BLAST-Lite"].loc[list(SAME_CELLS.values())]
    assert own.index.tolist() == list(SAME_CELLS)
    np.testing.assert_allclose(own[OTHER], theirs[OTHER], rtol=0.1)
    np.testing.assert_allclose(own[SAVED], theirs[SAVED], atol=2.5)
    assert own[SAVED].median() * theirs[SAVED].median() > 0.0


def test_a_parked_car_by_both() -> None:
    """Zero power at 25 and 35 degC: within 5 % of each other, and more in the heat."""
    theirs = foreign("blast", "blast_lite")
    for own in CELL_JUDGES:
        cold, hot = (
            (own.loss(parked(kelvin)), theirs[SAME_CELLS[own.name]].loss(parked(kelvin)))
            for kelvin in (298.15, 308.15)
        )
        assert cold[0] == pytest.approx(cold[1], rel=0.05)
        assert hot[0] == pytest.approx(hot[1], rel=0.05)
        assert cold[1] < hot[1]


def test_sei_of_pybamm_grows_with_heat_by_its_activation_energy() -> None:
    """Parked at 25 and 35 degC: the ratio is the one of the Arrhenius term of O'Kane et al. 2022."""
    sei = foreign("pybamm", "pybamm_cell")["SEI, solvent diffusion"]
    cold, hot = (sei.loss(parked(kelvin)) for kelvin in (298.15, 308.15))
    arrhenius = np.exp(37000.0 / 8.314 * (1.0 / 298.15 - 1.0 / 308.15))
    assert hot / cold == pytest.approx(arrhenius, rel=0.02)


def test_a_solve_that_fails_names_second_and_voltage() -> None:
    sei = foreign("pybamm", "pybamm_cell")["SEI, solvent diffusion"]
    empty = Exposure(TIME_S, np.linspace(0.3, -0.4, TIME_S.size), np.full(TIME_S.size, 298.15))
    with pytest.raises(iptm.IptmError, match=r"inimum voltage.* at \d+ s and 2\.\d+ V"):
        sei.loss(empty)


def test_the_command_prints_savings_and_keeps_them(
    runs: Runs,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("iptm_judges.cli.cache_directory", lambda: tmp_path / "cache")
    files = [str(run.save(tmp_path / f"{place}.npz")) for place, run in enumerate(runs)]
    assert main([*files, "--crossed"]) == 0
    printed = capsys.readouterr().out
    assert "laws of cells: " in printed
    assert "by temperature alone" in printed
    kept = len(list((tmp_path / "cache" / "judged").iterdir()))
    assert kept == (len(CELL_JUDGES) + 2) * 4
    assert main([*files, "--crossed"]) == 0
    assert capsys.readouterr().out == printed
    assert len(list((tmp_path / "cache" / "judged").iterdir())) == kept
    assert main(files[:1]) == 0
    assert "saved" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("by", "message"),
    [
        ("cell", "unknown group of judges 'cell'.*cells"),
        ("cells/NMC", "unknown judge 'NMC'.*NMC111"),
    ],
)
def test_what_is_unknown_is_one_line(
    runs: Runs, by: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(iptm.IptmError, match=message):
        runs[0].judge(by=[by])
    assert main([str(runs[0].save(tmp_path / "run.npz")), "--by", by]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_a_judge_that_fails_is_named_and_the_others_count(
    runs: Runs, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("iptm_judges.cli.cache_directory", lambda: tmp_path / "cache")
    monkeypatch.setattr(judging, "CELL_JUDGES", (replace(CELL_JUDGES[0], function=failing),))
    run = str(runs[0].save(tmp_path / "run.npz"))
    assert main([run, "--by", "paper", "cells/NCA"]) == 1
    printed = capsys.readouterr()
    assert "NCA: law NCA: 601 rows" in printed.err
    assert "paper's law" in printed.out


def test_an_extra_that_is_not_installed_is_named(
    runs: Runs, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = import_module

    def without_blast(name: str) -> Any:
        if name == "iptm_judges.blast_lite":
            raise ModuleNotFoundError("No module named 'blast'", name="blast")
        return real(name)

    monkeypatch.delitem(sys.modules, "iptm_judges.blast_lite", raising=False)
    monkeypatch.setattr(judging, "import_module", without_blast)
    with pytest.raises(iptm.IptmError, match=r"blast needs blast, which is not installed.*judges"):
        runs[0].judge(by=["blast"])
