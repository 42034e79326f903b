"""How well the vehicle ahead of a leader forecasts it: errors and bounds on platoons that were held out."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
from studies.chain.platoons import HELD_OUT, LEADS_S, Instants, instants

from iptm_core.state import FloatArray
from iptm_its.car_following import Past, shipped_law
from iptm_v2x_bridge.prediction.expected_motion import DECAY_S

SHOWN_S = (1.0, 2.0, 5.0, 10.0)
ONE_S = 1.0
EQUIPPED = (0.05, 0.1, 0.2, 0.5, 1.0)


def decaying_m(past: Past, decay_s: float) -> FloatArray:
    """Return distances that a leader drives whose acceleration decays, shape (n, leads)."""
    speed, times = past.speed_m_s[:, :1], np.array(LEADS_S)
    acceleration = speed - past.speed_m_s[:, 1:2]
    driven = speed * times + acceleration * decay_s * (
        times - decay_s * (1.0 - np.exp(-times / decay_s))
    )
    return np.maximum.accumulate(np.maximum(driven, 0.0), axis=1)


def held_out(vehicles_ahead: int, rows: int | None = None) -> Instants:
    """Return the instants of runs that the law is not fitted to, evenly spread ones if not all are wanted."""
    found = instants(vehicles_ahead)
    chosen = np.flatnonzero(np.isin(found.run, HELD_OUT))
    if rows is not None:
        chosen = chosen[np.linspace(0, chosen.size - 1, rows).astype(int)]
    return found.where(chosen)


def errors(rows: int | None = None) -> list[dict[str, Any]]:
    """Return a row per forecast: rms errors of the position at `SHOWN_S`, and how often bounds hold."""
    law = shipped_law()
    table = []
    usual: dict[str, Callable[[Past], FloatArray]] = {
        f"acceleration decays in {ONE_S:g} s": lambda past: decaying_m(past, ONE_S),
        f"acceleration decays in {DECAY_S:g} s": lambda past: decaying_m(past, DECAY_S),
    }
    for ahead, name in ((1, "vehicle ahead of the leader"), (2, "only the one ahead of that")):
        data = held_out(ahead, rows)
        of_usual = {each: data.driven_m - driven(data.past) for each, driven in usual.items()}
        if ahead == 1:
            table += [_row(each, error) for each, error in of_usual.items()]
        motion = law.motion(data.past)
        error, spread = data.driven_m - motion.driven_m[:, 1:], motion.spread_m[:, 1:]
        row = _row(name, error) | {"seconds": len(data.run)}
        inside = np.mean(abs(error) <= law.half_90[1:] * spread, axis=0)
        behind = np.mean(error < -law.behind_99[1:] * spread, axis=0)
        for lead_s, place in _places().items():
            base = next(iter(of_usual.values()))
            row[f"less_{lead_s:g}"] = 100.0 * (1.0 - _rms(error)[place] / _rms(base)[place])
            row[f"inside_{lead_s:g}"] = 100.0 * inside[place]
            row[f"behind_{lead_s:g}"] = 100.0 * behind[place]
        table.append(row)
    return table


def of_equipped(rows: int | None = None) -> list[dict[str, float]]:
    """Return a row per share of equipped vehicles: errors if only messages show who is ahead of it.

    Each vehicle is equipped independently; the nearer of the two ahead of the leader that is counts.
    """
    law, found = shipped_law(), []
    squares = {}
    for ahead in (1, 2):
        data = held_out(ahead, rows)
        error = data.driven_m - law.motion(data.past).driven_m[:, 1:]
        squares[ahead] = (error**2).mean(axis=0)
        usual = ((data.driven_m - decaying_m(data.past, ONE_S)) ** 2).mean(axis=0)
    for share in EQUIPPED:
        parts = share, (1.0 - share) * share
        mean = parts[0] * squares[1] + parts[1] * squares[2] + (1.0 - sum(parts)) * usual
        row = {
            f"rms_{lead_s:g}": float(np.sqrt(mean[place])) for lead_s, place in _places().items()
        }
        found.append({"share": 100.0 * share, **row})
    return found


def _places() -> dict[float, int]:
    return {lead_s: LEADS_S.index(lead_s) for lead_s in SHOWN_S}


def _rms(error: FloatArray) -> FloatArray:
    rms: FloatArray = np.sqrt((error**2).mean(axis=0))
    return rms


def _row(name: str, error: FloatArray) -> dict[str, Any]:
    blank = {
        f"{kind}_{lead_s:g}": np.nan
        for kind, lead_s in product(("less", "inside", "behind"), SHOWN_S)
    }
    rms = _rms(error)
    shown = {f"rms_{lead_s:g}": rms[place] for lead_s, place in _places().items()}
    return {"forecast": name, **blank, **shown}
