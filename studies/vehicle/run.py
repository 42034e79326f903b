"""The vehicle interface in real time on the bench car, killed and disturbed, and what it costs.

Drives in real time, what is read from their logs and the leaders are kept under
results/vehicle, and made anew where a file is deleted. A busy machine shows in the drives: it should do
little else meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
from studies.session import Session
from studies.vehicle.authority import BRAKING_TRIALS, leaders_table
from studies.vehicle.bench import OFTEN, faulty, kept, kills, other_dbc
from studies.vehicle.cycles import DRIVES, STRATEGIES, drives_table
from studies.vehicle.meter import bench_shadows

from iptm_vehicle_interface.drive_record import replayed
from iptm_vehicle_interface.driving import Driver
from iptm_vehicle_interface.vehicle import load_vehicle

MEASURES_TIME = True
FAULT_AT_S, FAULT_DRIVE_S, FIRST_ENGAGED_S = 25.0, 45.0, 4.5
OTHER_DBC = "other"
FAULTS: Mapping[str, list[str]] = {
    "none": [],
    "10 % of frames lost": ["--lost", "0.1"],
    "frames up to 50 ms late": ["--late-s", "0.05"],
    "DBC of another car": ["--vehicle", OTHER_DBC],
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
KILLS, KILL_CYCLE, KILL_SEED = 210, "comprehensive", 40
_ON_THE_BENCH = ("drives", "kills", "faults")


def run(session: Session) -> bool:
    """Run the study; returns whether no car came too near and no frame was blocked."""
    values: dict[str, Any] = dict.fromkeys(("drives", "kills", "faults", "replay", "shadow"))
    if session.short:
        leaders = leaders_table(session)
    else:
        rows = kept(
            session.scratch / "leaders.json", lambda: leaders_table(session).to_dict("records")
        )
        leaders = pd.DataFrame(rows)
        values["drives"] = drives_table(session)
        values["kills"] = _kills(session)
        values["faults"] = _faults(session)
        values["replay"] = _replay(session)
        table = pd.DataFrame(bench_shadows(session, DRIVES[1].folder(session), STRATEGIES[0]))
        table["difference"] = 100.0 * (table.driven_battery_energy_kwh / table.own_kwh - 1.0)
        values["shadow"] = table
    session.render(trials=BRAKING_TRIALS, leaders=leaders, **values)
    held = [(leaders.collisions == 0).all()]
    held += [(values[name].gap_m > 0.0).all() for name in _ON_THE_BENCH if values[name] is not None]
    return bool(all(held))


# --- in real time


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
                "missed": int(group.at_s.isna().sum()),
                "drove_on": int((group.drove_on == True).sum()),  # noqa: E712 - missing without an event
                "reported": int((group.reported == True).sum()),  # noqa: E712
                "engagements": int(group.engagements.iloc[0]),
                "gap_m": group.smallest_gap_m.iloc[0],
                "all": len(events),
            }
        )
    return pd.DataFrame(rows)


def _faults(session: Session) -> pd.DataFrame:
    rows = []
    other = str(other_dbc(session.scratch / "other_dbc"))
    for number, (name, fault) in enumerate(FAULTS.items()):
        options = [other if option == OTHER_DBC else option for option in fault]
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
    for each in DRIVES:
        folder = each.folder(session) / "record"
        found = kept(folder / "replayed.json", partial(_replayed, folder))
        rows.append({"record": each.folder(session).name, **found})
    return pd.DataFrame(rows)


def _replayed(folder: Path) -> dict[str, int]:
    """Return how many frames a record has, and how many of them are others when it is replayed."""
    pairs = [was == now for _, was, now in replayed(folder, Driver(load_vehicle("bench")))]
    return {"frames": len(pairs), "different": pairs.count(False)}
