"""A store of made runs: a figure for everything, driven by no controller."""

from typing import Any

import numpy as np

from iptm.channel_record import ChannelRecord
from iptm.studies.campaign import Campaign, plan_campaign, survey
from iptm.studies.run import Run
from iptm.studies.run_spec import RunKind
from iptm.studies.store import ResultStore
from iptm.studies.study import Case
from iptm.studies.study_loading import available_studies
from iptm_core.decision_record import DECISION_COLUMNS, DecisionSeries
from iptm_core.settings import ThermalModel
from iptm_core.trajectory import TRAJECTORY_COLUMNS, Trajectory
from iptm_reproduction.claims import Claim, make_claim

TRIP_S = 200.0


def made_trip(inputs: Case, rng: np.random.Generator) -> Trajectory:
    """A trip behind the leader that no controller drove; the weights and the horizon shift its figures.

    Those of a whole trip as one problem are the best.
    """
    times = np.arange(inputs.ticks + 1.0)
    ease = 0.85 if inputs.spec.kind is RunKind.WHOLE_TRIP else 1.0 - 0.1 * rng.random()
    speed = ease * inputs.route.leader.speeds_at(times)
    traction = 300.0 * speed + 4000.0 * np.gradient(speed)
    compressor = 400.0 * ease * (traction < np.median(traction))
    cooled = 5.0 * ease * (1.0 - np.exp(-times / 40.0))
    columns = dict.fromkeys(TRAJECTORY_COLUMNS, 300.0) | {
        "time_s": times,
        "position_m": ease * inputs.route.leader.positions_at(times) - 30.0,
        "speed_m_s": speed,
        "acceleration_m_s2": np.zeros(times.size),
        "compressor_power_w": compressor,
        "cell_1_temperature_k": 308.15 - cooled,
        "cell_n_temperature_k": 308.15 - 0.6 * cooled,
        "cell_1_capacity_loss": 1e-3 + 1e-9 * ease * times,
        "cell_n_capacity_loss": 1e-3 + 1.1e-9 * ease * times,
        "traction_power_w": traction,
        "auxiliary_power_w": np.full(times.size, 200.0),
        "battery_power_w": traction + compressor + 200.0,
        "leader_position_m": inputs.route.leader.positions_at(times),
        "leader_speed_m_s": inputs.route.leader.speeds_at(times),
        "service_braking_s": 0.0,
        "smallest_gap_m": 1e3,
    }
    return Trajectory.from_arrays(
        {name: np.broadcast_to(values, times.shape) for name, values in columns.items()}
    )


def made_run(inputs: Case) -> Run:
    rng = np.random.default_rng(int(inputs.key[:12], 16))
    whole = inputs.spec.kind is RunKind.WHOLE_TRIP
    times = np.arange(float(inputs.ticks))
    columns = dict.fromkeys(DECISION_COLUMNS, np.zeros(times.size)) | {
        "time_s": times,
        "solve_time_s": 1e-3 * (1.0 + rng.random(times.size)),
        "iterations": np.full(times.size, 5),
        "cell_1_marginal_cost_1_k": np.full(times.size, 1.5),
        "cell_n_marginal_cost_1_k": np.full(times.size, 4.5),
    }
    solve = {"status": "solved", "iterations": 100, "time_s": 20.0}
    solve |= {"objective": 1.5, "infeasibility": 1e-6, "moved_m": 30.0}
    whole_trip: Any = {
        "settled": True,
        "solves": [solve, {**solve, "moved_m": None}],
        **dict.fromkeys(("gap_slack_m", "speed_slack_m_s", "temperature_slack_k"), 0.0),
        "costate_times_s": [100.0, 200.0],
        "cell_1_costates_1_k": [2.0, 0.0],
        "cell_n_costates_1_k": [6.0, 0.0],
    }
    full_channel = inputs.spec.thermal_model is ThermalModel.FULL_CHANNEL
    return Run(
        key=inputs.key,
        spec=inputs.spec,
        parameters=inputs.parameters,
        trajectory=made_trip(inputs, rng),
        decisions=None if whole else DecisionSeries.from_arrays(columns),
        whole_trip=whole_trip if whole else None,
        wall_time_s=2.5,
        compiled=True,
        finished_at_utc="2026-01-01T00:00:00+00:00",
        git_revision="0123456789abcdef",
        versions={"python": "3.11.0", "casadi": "3.7.0"},
        fingerprint=inputs.fingerprint,
        channel=made_channel(rng) if full_channel else None,
    )


def made_channel(rng: np.random.Generator) -> ChannelRecord:
    """Ten cells of which the ninth is the hottest."""
    rising = np.sort(rng.random(10)).tolist()
    profile = [300.0 + value for value in rising]
    return ChannelRecord(
        mean_temperatures_k=profile,
        max_temperatures_k=profile,
        capacity_losses=[1e-6 * (1.0 + value) for value in rising],
        hottest_shares=[0.0] * 8 + [0.75, 0.25],
        peak={"cell": 9, "time_s": 50.0, "temperature_k": 312.5, "excess_k": 0.5},
        largest_excess={"cell": 9, "time_s": 60.0, "temperature_k": 310.0, "excess_k": 0.625},
        line_rms_k=rising,
        line_max_k=rising,
        line={"rms_k": 0.25, "max_k": 1.5},
        two_cell_1={"rms_k": 0.125, "max_k": 0.5},
        two_cell_n={"rms_k": 0.375, "max_k": 0.875},
        two_cell_losses=[1e-6, 2e-6],
        profile_times_s=[10.0, 20.0],
        profiles_k=[profile, profile],
    )


def filled(store: ResultStore, names: list[str]) -> None:
    """Store a made run for everything that the studies need."""
    campaign = plan_campaign(names, TRIP_S)
    while new := campaign.take():
        for inputs in new:
            run = made_run(inputs)
            store.save(run)
            campaign.finish(run)


def surveyed(store: ResultStore) -> Campaign:
    campaign = plan_campaign(available_studies(), TRIP_S)
    survey(campaign, store)
    return campaign


def made_claim(kind: str, **arguments: Any) -> Claim:
    """Return a statement with a check of a kind."""
    return make_claim(
        {"id": "a", "where": "Section I", "statement": "It is so.", "check": {kind: arguments}}
    )
