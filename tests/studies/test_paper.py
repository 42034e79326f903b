"""Checks of the paper's statements by hand, what a set refuses, and trips integrated once more."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from studies.paper import checks, equations, run, statements, trips

import iptm

NO_GATE = {"chiller.gate_power_w": 0.0}
STUDY = Path(run.__file__).parent
AS_PRINTED = str(STUDY / "as_printed.yaml")


def made(**figures: list[float]) -> pd.DataFrame:
    """Figures of the runs a, b, c, ... of a study s."""
    return pd.DataFrame(
        figures, index=[f"s/{name}" for name in "abcde"[: len(next(iter(figures.values())))]]
    )


def verdict(figures: pd.DataFrame, name: str, **cells: str) -> str:
    row = pd.Series({**dict.fromkeys(statements.claims().columns, ""), "check": name, **cells})
    return checks.check(row, figures).verdict


@pytest.mark.parametrize(
    ("name", "cells", "values", "expected"),
    [
        ("change", {"run": "s/b", "base": "s/a", "printed": "-10"}, [100.0, 92.4], "✓"),
        ("change", {"run": "s/b", "base": "s/a", "printed": "-10"}, [100.0, 92.6], "≈"),
        ("change", {"run": "s/b", "base": "s/a", "printed": "-10"}, [100.0, 101.0], "✗"),
        ("change", {"run": "s/b|c", "base": "s/a", "printed": "-20 -10"}, [100.0, 90.0, 80.0], "✓"),
        ("change_within", {"run": "s/b", "base": "s/a", "most": "-12"}, [100.0, 88.0], "✓"),
        ("change_within", {"run": "s/b", "base": "s/a", "most": "-12"}, [100.0, 89.0], "≈"),
        ("value", {"run": "s/a", "printed": "6", "share": "0.25", "least": "1"}, [7.5], "✓"),
        ("value", {"run": "s/a", "printed": "6", "share": "0.25", "least": "1"}, [7.6], "≈"),
        ("within", {"run": "s/a|b", "least": "5", "share": "1"}, [5.0, 6.0], "✓"),
        ("within", {"run": "s/a|b", "least": "5", "share": "1"}, [4.9, 6.0], "≈"),
        ("within", {"run": "s/a", "most": "0"}, [1.0], "✗"),
        ("lower", {"run": "s/a", "base": "s/b|c"}, [1.0, 2.0, 3.0], "✓"),
        ("lower", {"run": "s/a", "base": "s/b|c"}, [1.0, 1.0, 3.0], "✗"),
        ("lower", {"run": "s/a", "base": "s/b|c", "share": "0.5"}, [1.0, 1.0, 3.0], "✓"),
        ("between", {"run": "s/a", "base": "s/b|c"}, [2.0, 3.0, 1.0], "✓"),
        ("between", {"run": "s/a", "base": "s/b|c"}, [4.0, 3.0, 1.0], "✗"),
        ("between", {"run": "s/a", "base": "s/b|c", "share": "0"}, [4.0, 3.0, 1.0], "✓"),
        ("rank", {"run": "s/a", "base": "s/a|b|c", "printed": "2"}, [2.0, 1.0, 3.0], "✓"),
        ("rank", {"run": "s/a", "base": "s/a|b|c", "printed": "2"}, [1.0, 2.0, 3.0], "✗"),
        ("best", {"run": "x=s/a; y=s/b; z=s/c", "printed": "y; x"}, [2.0, 1.0, 3.0], "✓"),
        ("best", {"run": "x=s/a; y=s/b; z=s/c", "printed": "x"}, [2.0, 1.0, 3.0], "✗"),
        ("trend", {"run": "s/a|b|c", "figure": "-f", "least": "1"}, [100.0, 99.5, 99.0], "✓"),
        ("trend", {"run": "s/a|b|c", "figure": "-f", "least": "1"}, [100.0, 99.5, 99.2], "≈"),
        ("trend", {"run": "s/a|b|c", "figure": "+f"}, [100.0, 99.9, 101.0], "≈"),
        ("trend", {"run": "s/a|b|c", "figure": "+f"}, [100.0, 99.96, 101.0], "✓"),
        ("trend", {"run": "x=s/a|b; y=s/c|d", "figure": "+f"}, [1.0, 2.0, 2.0, 1.0], "✗"),
        (
            "trend",
            {"run": "x=s/a|b; y=s/c|d", "figure": "+f", "share": "0.5"},
            [1.0, 2.0, 2.0, 1.0],
            "✓",
        ),
        ("trend_ends", {"run": "s/a|b|c", "figure": "+f"}, [1.0, 0.5, 2.0], "✓"),
        ("not_always", {"run": "s/a|b|c", "figure": "-f"}, [3.0, 3.1, 1.0], "✓"),
        ("not_always", {"run": "s/a|b|c", "figure": "-f"}, [3.0, 2.0, 1.0], "✗"),
        ("most_steps", {"run": "x=s/a|b|c", "figure": "+f"}, [1.0, 2.0, 1.0], "✗"),
        ("most_steps", {"run": "x=s/a|b|c; y=s/a|b", "figure": "+f"}, [1.0, 2.0, 1.0], "✓"),
        ("levels_off", {"run": "s/a|b|c|d|e"}, [100.0, 90.0, 88.0, 87.0, 86.0], "✓"),
        ("levels_off", {"run": "s/a|b|c|d|e"}, [100.0, 99.0, 98.0, 95.0, 80.0], "≈"),
        ("spread", {"run": "x=s/a|b", "least": "5"}, [100.0, 105.0], "✓"),
        ("spread", {"run": "x=s/a|b", "most": "2"}, [100.0, 105.0], "✗"),
        ("ordered", {"run": "s/a", "base": "s/b", "figure": "f<f f>f"}, [1.0, 2.0], "≈"),
        ("change", {"run": "s/b", "base": "s/z", "printed": "-10"}, [100.0, 92.5], "–"),
    ],
)
def test_a_check_by_hand(
    name: str, cells: dict[str, str], values: list[float], expected: str
) -> None:
    assert verdict(made(f=values), name, **{"figure": "f", **cells}) == expected


def test_statements_name_runs_and_checks_that_exist() -> None:
    known = {*trips.paper_runs(), *(f"strategies/{name}" for name in trips.NAMES)}
    for claim in statements.claims().itertuples():
        assert claim.check in checks.CHECKS
        for cell in (claim.run, claim.base):
            assert {a for each in statements.series(cell).values() for a in each} <= known, (
                claim.Index
            )
    assert len(statements.claims()) == 75
    assert (statements.claims().held_back != "").sum() == 25


def test_what_the_paper_prints_reproduces_itself() -> None:
    """Its own table fulfils its own sentences."""
    claims, table = statements.claims(), statements.printed_table()
    tested = {
        key: checks.check(row, table).verdict
        for key, row in claims.iterrows()
        if row.figure
        and set(row.figure.split()) <= set(table.columns)
        and {
            a
            for cell in (row.run, row.base)
            for each in statements.series(cell).values()
            for a in each
        }
        <= set(table.index)
    }
    assert len(tested) > 15
    assert {*tested.values()} == {"✓"}


def test_the_set_of_the_print_is_refused_without_its_gate() -> None:
    with pytest.raises(
        iptm.IptmError, match=r"reproduction of the paper.*chiller\.gate_power_w only"
    ):
        iptm.simulate("us06", duration_s=2.0, vehicle=AS_PRINTED)
    driven = iptm.simulate(
        "us06", duration_s=2.0, vehicle=AS_PRINTED, overrides=NO_GATE, strategy="production"
    )
    assert driven.parameters.chiller.gate_power_w == 0.0


@pytest.mark.parametrize(
    "trip",
    [
        {"cycle": "us06", "strategy": "aging", "horizon": "15x1"},
        {"cycle": "nycc", "strategy": "reference", "horizon": "15x1"},
        {"cycle": "sc03", "strategy": "aging", "horizon": "3x1+5x5"},
    ],
    ids=lambda trip: trip["cycle"],
)
def test_a_trip_as_printed_is_that_of_a_program_of_its_own(trip: dict[str, Any]) -> None:
    """The recorded commands, integrated again from the paper's equations in NumPy."""
    driven = iptm.simulate(**trip, duration_s=200.0, vehicle=AS_PRINTED, overrides=NO_GATE)
    frame = driven.frame
    again = equations.integrate(frame, driven.parameters, steps=20)
    for cell in ("cell_1", "cell_n"):
        loss = f"{cell}_capacity_loss"
        own, theirs = (float(each[loss].iloc[-1] - each[loss].iloc[0]) for each in (again, frame))
        assert own == pytest.approx(theirs, rel=1e-6)
        heat = f"{cell}_temperature_k"
        np.testing.assert_allclose(again[heat], frame[heat], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(again.position_m, frame.position_m, atol=1e-6)
    for power in ("battery_power_w", "chiller_heat_w", "battery_heat_w"):
        own, theirs = (float(each[power].iloc[1:].sum()) for each in (again, frame))
        assert own == pytest.approx(theirs, rel=1e-6)
