"""The vehicle interface in real time on the bench car, killed, disturbed and judged, and what it costs.

Drives in real time, what is read from their logs, the leaders and the meter's errors are kept under
results/vehicle, and made anew where a file is deleted. A busy machine shows in the drives: it should do
little else meanwhile.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from studies.acc.scenes import LONGEST_S, SCENES, SHORTEST_S, measured_scenes
from studies.safety.braking import braking_trials
from studies.session import Case, Session
from studies.vehicle.bench import OFTEN, drive, faulty, kept, kills, settled_jerk_m_s3
from studies.vehicle.meter import i3_trips, public_log
from studies.vehicle.opendbc_judge import CARS, build, judged

import iptm
from iptm_vehicle_interface.drive_record import replayed
from iptm_vehicle_interface.driving import Driver, controller_limits
from iptm_vehicle_interface.vehicle import load_vehicle

MEASURES_TIME = True
CYCLES = {"us06": 600.0, "wltc_class3b": 1800.0}
STRATEGIES = ("aging_cost_to_go", "reference")
FAULT_AT_S, FAULT_DRIVE_S, FIRST_ENGAGED_S = 25.0, 45.0, 4.5
FAULTS: Mapping[str, list[str]] = {
    "none": [],
    "10 % of frames lost": ["--lost", "0.1"],
    "frames up to 50 ms late": ["--late-s", "0.05"],
    "2 % of checksums wrong": ["--bad-checksum", "0.02"],
    "all checksums wrong": ["--bad-checksum", "1"],
    "radar frozen": ["--frozen-from-s", f"{FAULT_AT_S}"],
    **{
        f"silent for {length_s:g} s": ["--silent", f"{FAULT_AT_S}:{FAULT_AT_S + length_s}"]
        for length_s in (0.2, 0.5, 1.0, 2.0, 5.0)
    },
    "driver brakes": ["--press", f"brake_pressed:{FAULT_AT_S}:1"],
    "driver accelerates": ["--press", f"accelerator_pressed:{FAULT_AT_S}:2"],
    "the vehicle reports a fault": ["--press", f"vehicle_fault:{FAULT_AT_S}:1"],
}
KILLS, KILL_CYCLE, KILL_SEED = 200, "wltc_class3b", 40
AUTHORITIES = (
    ("none", 3.5, 1.5),
    ("none", 8.0, 1.5),
    ("full", 3.5, 1.5),
    ("full", 3.5, 2.0),
    ("full", 3.5, 2.5),
    ("full", 3.5, 3.0),
    ("full", 8.0, 1.5),
)
"""Preview, braking of channel or brakes in m/s^2, and headway of s_min in s."""
RELIED_ON_M_S2 = 7.0
"""Of stronger brakes the safety monitor relies on this."""
BRAKING_CYCLE = "us06"
BRAKING_TRIALS, BRAKING_SEED = 200, 39
SHORT_S = 60.0
_ON_THE_BENCH = ("drives", "kills", "faults")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the paths of code and data from outside the project."""
    add = parser.add_argument
    add("--opendbc", type=Path, metavar="DIR", help="unpacked package opendbc, for the judge")
    add("--i3", type=Path, metavar="FILE", help="recorded trips of the BMW i3, compact form")
    add("--log", type=Path, metavar="DIR", help="folder of brz_candump.log.gz and brz.dbc")


def run(session: Session) -> bool:
    """Run the study; returns whether no car came too near and no frame was blocked."""
    values: dict[str, Any] = dict.fromkeys(
        ("drives", "kills", "faults", "judge", "replay", "i3", "log")
    )
    if session.short:
        leaders = _leaders(session)
    else:
        rows = kept(session.scratch / "leaders.json", lambda: _leaders(session).to_dict("records"))
        leaders = pd.DataFrame(rows)
        values["drives"] = _drives(session)
        values["kills"] = _kills(session)
        values["faults"] = _faults(session)
        values["replay"] = _replay(session)
    options = session.options
    if options.opendbc:
        values["judge"] = _judge(session, options.opendbc)
    if options.i3:
        values["i3"] = kept(session.scratch / "i3.json", partial(_i3, options.i3))
    if options.log:
        values["log"] = public_log(session, options.log)
    session.render(trials=BRAKING_TRIALS, leaders=leaders, **values)
    held = [(leaders.collisions == 0).all()]
    held += [(values[name].gap_m > 0.0).all() for name in _ON_THE_BENCH if values[name] is not None]
    if values["judge"] is not None:
        held.append((values["judge"].blocked_while_engaged == 0).all())
    return bool(all(held))


# --- in real time


def _drive_folder(session: Session, cycle: str, strategy: str) -> Path:
    return session.scratch / "drives" / f"{cycle}_{strategy}"


def _drives(session: Session) -> pd.DataFrame:
    """Compare drives in real time with the same ones in lock-step, with the same limits and no preview.

    The bench car has no safety monitor but the gateway, so neither has the lock-step trip it is compared
    with; the one with the monitor of the simulated plant is shown beside it.
    """
    limits = controller_limits(load_vehicle("bench"))
    cases = [
        Case(
            f"{cycle}/{strategy}/{monitor}",
            {"cycle": cycle, "strategy": strategy, "monitor": monitor},
            {
                "cycle": cycle,
                "strategy": strategy,
                "preview_mode": "none",
                "overrides": limits,
                "duration_s": duration_s,
                "safety_monitor": monitor,
            },
        )
        for cycle, duration_s in CYCLES.items()
        for strategy in STRATEGIES
        for monitor in (False, True)
    ]
    rows = []
    driven = session.drive(cases)
    monitored = driven[driven.monitor].set_index(["cycle", "strategy"])
    for _, each in driven[~driven.monitor].iterrows():
        folder = _drive_folder(session, each.cycle, each.strategy)
        duration_s = CYCLES[each.cycle]
        found = kept(
            folder / "result.json",
            partial(drive, folder, each.cycle, each.strategy, duration_s),
        )
        car, suite, trajectory = found["car"], found["suite"], each.run.trajectory
        beside = monitored.loc[(each.cycle, each.strategy)]
        losses = trajectory.cell_1_capacity_loss + trajectory.cell_n_capacity_loss
        rows.append(
            {
                "cycle": each.cycle,
                "strategy": each.strategy,
                "energy_kwh": car["battery_energy_j"] / 3.6e6,
                "step_energy_kwh": _energy_j(each.run) / 3.6e6,
                "monitored_energy_kwh": _energy_j(beside.run) / 3.6e6,
                "monitored_distance_km": float(beside.run.trajectory.position_m[-1]) / 1000.0,
                "interventions": beside.metrics.interventions,
                "loss_ppm": 1e6 * car["capacity_loss"],
                "step_loss_ppm": 1e6 * float(losses[-1] - losses[0]),
                "distance_km": car["distance_m"] / 1000.0,
                "step_distance_km": float(trajectory.position_m[-1]) / 1000.0,
                "engaged": 100.0 * car["active_s"] / duration_s,
                "hand_overs": sum(mode == "engaged" for _, mode, _ in suite["changes"]) - 1,
                "oldest_ms": 1e3 * car["oldest_command_s"],
                "engagements": car["engagements"],
                "jerk": car["largest_jerk_m_s3"],
                "settled_jerk": kept(
                    folder / "settled_jerk.json",
                    partial(settled_jerk_m_s3, folder / "car_frames.log"),
                ),
                "gap_m": car["smallest_gap_m"],
                "late_p99_ms": 1e3 * suite["late_p99_s"],
                "late_max_ms": 1e3 * suite["late_max_s"],
                "fallbacks": suite["fallbacks"],
            }
        )
    return _with_savings(pd.DataFrame(rows))


def _energy_j(run: iptm.Run) -> float:
    """Return the energy from the battery of a trip in memory."""
    trajectory = run.trajectory
    return float(np.sum(trajectory.battery_power_w[1:] * trajectory.intervals_s))


def _with_savings(table: pd.DataFrame) -> pd.DataFrame:
    """Add what the first strategy saves against the second, per distance, in real time and in lock-step."""
    for prefix in ("", "step_", "monitored_"):
        for name in ("energy_kwh", "loss_ppm"):
            if f"{prefix}{name}" in table:
                per_km = table[f"{prefix}{name}"] / table[f"{prefix}distance_km"]
                of_base = per_km.where(table.strategy == STRATEGIES[1])
                base = of_base.groupby(table.cycle).transform("max")
                saving = 100.0 * (1.0 - per_km / base)
                table[f"{prefix}{name.partition('_')[0]}_saving"] = saving
    return table


def _kills(session: Session) -> pd.DataFrame:
    folder = session.scratch / "kills"
    events = pd.DataFrame(
        kept(folder / "kills.json", lambda: kills(folder, KILLS, KILL_CYCLE, KILL_SEED))
    )
    rows = []
    for (process, how), group in events.groupby(["process", "signal"]):
        times = group.inactive_after_s
        rows.append(
            {
                "process": process,
                "signal": how,
                "events": len(group),
                "median_ms": 1e3 * times.median(),
                "max_ms": 1e3 * times.max(),
                "missed": int(times.isna().sum()),
                "reported": int((group.reported == True).sum()),  # noqa: E712 - missing without an event
                "engagements": int(group.engagements.iloc[0]),
                "gap_m": group.smallest_gap_m.iloc[0],
                "all": len(events),
            }
        )
    return pd.DataFrame(rows)


def _faults(session: Session) -> pd.DataFrame:
    rows = []
    for number, (name, options) in enumerate(FAULTS.items()):
        folder = session.scratch / "faults" / f"{number}"
        found = kept(
            folder / "result.json",
            partial(faulty, folder, [*OFTEN, *options], FAULT_DRIVE_S),
        )
        rows.append(
            {"fault": name, **_reaction(found, begins=f"{FAULT_AT_S}" in " ".join(options))}
        )
    return pd.DataFrame(rows)


def _reaction(found: Mapping[str, Any], *, begins: bool) -> dict[str, Any]:
    """Return how the suite reacted to a fault of a drive, which begins in it or lasts all the time."""
    car, suite = found["car"], found["suite"]
    from_s = FAULT_AT_S - 0.5 if begins else FIRST_ENGAGED_S
    changes = [
        (time_s, mode, reason)
        for time_s, mode, reason in suite["changes"]
        if from_s <= time_s < FAULT_DRIVE_S - 0.5
    ]
    inactive = [at_s for at_s in car["inactive_at_s"] if at_s >= FAULT_AT_S]
    return {
        "reaction": "; ".join(dict.fromkeys(f"{mode}: {why}" for _, mode, why in changes))
        or ("goes on" if car["active_s"] else "never engaged"),
        "inactive_ms": 1e3 * (inactive[0] - FAULT_AT_S) if begins and inactive else math.nan,
        "engaged_s": car["active_s"],
        "engagements": car["engagements"],
        "gap_m": car["smallest_gap_m"],
        "oldest_ms": 1e3 * car["oldest_command_s"],
        "rejected": sum(suite["faults"].values()),
    }


def _replay(session: Session) -> pd.DataFrame:
    rows = []
    for cycle in CYCLES:
        folder = _drive_folder(session, cycle, STRATEGIES[0]) / "record"
        rows.append({"cycle": cycle, **kept(folder / "replayed.json", partial(_replayed, folder))})
    return pd.DataFrame(rows)


def _replayed(folder: Path) -> dict[str, int]:
    """Return how many frames a record has, and how many of them are others when it is replayed."""
    pairs = [was == now for _, was, now in replayed(folder, Driver(load_vehicle("bench")))]
    return {"frames": len(pairs), "different": pairs.count(False)}


def _judge(session: Session, package: Path) -> pd.DataFrame:
    """Pass the requests of all drives through opendbc's safety code."""
    library, rows = build(package), []
    logs = sorted(session.scratch.glob("*/*/car_frames.log"))
    for car in CARS:
        counts: Counter[str] = Counter()
        for log in logs:
            path = log.with_name(f"judged_by_{car.name}.json")
            counts.update(kept(path, partial(judged, library, car, log)))
        rows.append({"car": car.name, **{key.replace(" ", "_"): n for key, n in counts.items()}})
    return pd.DataFrame(rows)


def _i3(path: Path) -> dict[str, float]:
    trips = i3_trips(path)
    error = trips.error.abs()
    return {
        "trips": len(trips),
        "all": 100.0 * error.median(),
        "held_out": 100.0 * error[~trips.fitted].median(),
        "held_out_trips": int((~trips.fitted).sum()),
        "p90": 100.0 * float(np.percentile(error, 90)),
        "mean": 100.0 * trips.error.mean(),
    }


# --- with the authority of the channel, without a bus


def _leaders(session: Session) -> pd.DataFrame:
    """Drive behind measured leaders, and behind ones that brake, with the authority of the channel."""
    extent = (1, SHORTEST_S) if session.short else (SCENES, LONGEST_S)
    scenes = measured_scenes(None, session.say, *extent)
    trips = {
        scene.name: {
            "cycle": scene.write(session.scratch / "leads"),
            "duration_s": float(scene.duration_s),
        }
        for scene in scenes
    }
    trips[BRAKING_CYCLE] = {"cycle": BRAKING_CYCLE}
    kinds = [AUTHORITIES[0]] if session.short else AUTHORITIES
    cases = [
        Case(
            f"{name}/{number}",
            {"leader": name, "number": number},
            {**_with_authority(*kind), **trip},
        )
        for number, kind in enumerate(kinds)
        for name, trip in trips.items()
    ]
    if session.short:
        cases = [case.shortened(SHORT_S) for case in cases]
    driven = session.drive(cases)
    calls = {case.name: case.call for case in cases}
    rows = []
    for number, group in driven.groupby("number"):
        is_cycle = group.leader == BRAKING_CYCLE
        measured, cycle = group[~is_cycle], group[is_cycle].iloc[0]
        trials = braking_trials(
            calls[cycle.case],
            cycle.run.trajectory,
            3 if session.short else BRAKING_TRIALS,
            BRAKING_SEED,
        )
        hit = trials.impact_m_s > 0.0
        preview, authority_m_s2, headway_s = kinds[number]
        rows.append(
            {
                "preview": preview,
                "authority": authority_m_s2,
                "headway_s": headway_s,
                "leaders": len(measured),
                "collisions": sum(run.frame.gap_m.min() <= 0.0 for run in measured.run),
                "gap_m": min(run.frame.gap_m.min() for run in measured.run),
                "interventions": sum(metrics.interventions for metrics in measured.metrics),
                "braked": int(trials.braked.sum()),
                "hit": int(hit.sum()),
                "avoidable": int((hit & (trials.bound_impact_m_s <= 0.0)).sum()),
                "mean_gap_m": cycle.run.frame.gap_m.mean(),
                "energy_kwh_100km": _energy_j(cycle.run)
                / float(cycle.run.trajectory.position_m[-1])
                / 36.0,
            }
        )
    return pd.DataFrame(rows)


def _with_authority(preview: str, authority_m_s2: float, headway_s: float) -> dict[str, Any]:
    """Return the settings of trips whose brakes have an authority, which planner and monitor rely on."""
    limits = controller_limits(load_vehicle("bench"))
    return {
        "preview_mode": preview,
        "strategy": STRATEGIES[0],
        "monitor_own_deceleration_m_s2": min(authority_m_s2, RELIED_ON_M_S2),
        "overrides": {
            **limits,
            "brakes.max_deceleration_m_s2": authority_m_s2,
            "gap.time_headway_s": headway_s,
        },
    }
