"""What is kept of all cells of a channel, and where it comes from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from iptm.channel_record import ChannelRecord, channel_record
from iptm_core.parameters import load_parameters
from iptm_core.settings import ThermalModel
from iptm_core.state import ChannelCells, Command, FullChannelState
from iptm_plant_sim.plant import Plant
from iptm_plant_sim.plant_step import PlantStep

CELLS = 5
PARAMETERS = load_parameters(overrides={"pack.cells_per_channel": CELLS}).values
TWO_CELLS = Plant(PARAMETERS, np.zeros_like)
FULL = Plant(PARAMETERS, np.zeros_like, thermal_model=ThermalModel.FULL_CHANNEL)


def step_with(time_s: float, temperatures: list[float], losses: list[float]) -> PlantStep:
    """A standing car whose cells have given temperatures and losses."""
    start = FULL.initial_state()
    cells = ChannelCells(np.array(temperatures), np.array(losses))
    state = FullChannelState(
        **{
            **vars(start),
            "time_s": time_s,
            "cell_1_temperature_k": temperatures[0],
            "cell_n_temperature_k": temperatures[-1],
            "cell_1_capacity_loss": losses[0],
            "cell_n_capacity_loss": losses[-1],
            "cells": cells,
        }
    )
    return replace(FULL.observe(start), state=state)


@pytest.fixture(scope="module")
def record() -> ChannelRecord:
    steps = [
        step_with(0.0, [300.0, 301.0, 302.0, 303.0, 304.0], [1e-3] * CELLS),
        # A bump on cell 3: 3 K above the line of 300 to 304 K, 1 K above cell 5.
        step_with(1.0, [300.0, 301.0, 305.0, 303.0, 304.0], [1.001e-3] * CELLS),
        step_with(2.0, [306.0, 305.0, 304.0, 303.0, 302.0], [1.002e-3] * 4 + [1.006e-3]),
    ]
    return channel_record(steps, TWO_CELLS, 1.0)


def test_the_hottest_cell_is_found(record: ChannelRecord) -> None:
    assert (record["peak"]["cell"], record["peak"]["time_s"], record["peak"]["temperature_k"]) == (
        1,
        2.0,
        306.0,
    )
    assert record["peak"]["excess_k"] == 0.0
    found = record["largest_excess"]
    assert (found["cell"], found["time_s"], found["excess_k"]) == (3, 1.0, 1.0)
    assert record["hottest_shares"] == pytest.approx([1 / 3, 0.0, 1 / 3, 0.0, 1 / 3])


def test_the_line_misses_the_bump_only(record: ChannelRecord) -> None:
    assert record["line_max_k"] == pytest.approx([0.0, 0.0, 3.0, 0.0, 0.0])
    assert record["line_rms_k"] == pytest.approx([0.0, 0.0, 3.0 / np.sqrt(3.0), 0.0, 0.0])
    assert record["line"]["max_k"] == pytest.approx(3.0)
    assert record["line"]["rms_k"] == pytest.approx(3.0 / np.sqrt(15.0))


def test_sums_by_cell(record: ChannelRecord) -> None:
    assert record["capacity_losses"] == pytest.approx([2e-6] * 4 + [6e-6])
    assert record["mean_temperatures_k"][1] == pytest.approx((301.0 + 301.0 + 305.0) / 3.0)
    assert record["max_temperatures_k"] == [306.0, 305.0, 305.0, 303.0, 304.0]
    assert 1.0 in record["profile_times_s"], "the instant of the largest error"
    kept = dict(zip(record["profile_times_s"], record["profiles_k"], strict=True))
    assert kept[1.0] == [300.0, 301.0, 305.0, 303.0, 304.0]


def test_the_two_cell_model_gets_the_same_commands() -> None:
    """With two cells in the channel both plants are one, and hardly differ."""
    parameters = load_parameters(overrides={"pack.cells_per_channel": 2}).values
    two = Plant(parameters, np.zeros_like)
    full = Plant(parameters, np.zeros_like, thermal_model=ThermalModel.FULL_CHANNEL)
    steps = [full.observe(full.initial_state())]
    for _ in range(20):
        steps.append(full.advance(steps[-1].state, Command(1.0, 1500.0)))
    found = channel_record(steps, two, 1.0)
    change = abs(steps[-1].state.cell_n_temperature_k - steps[0].state.cell_n_temperature_k)
    assert change > 0.1
    assert 0.0 < found["two_cell_n"]["max_k"] < 1e-3 * change
    assert found["two_cell_losses"] == pytest.approx(found["capacity_losses"], rel=1e-3)
