"""Where the savings come from, and how much of the optimum of a whole trip they are.

Distance, foresight, cooling and smoothing are switched off one after the other. The optimum of a whole trip
knows all of it and is drawn to the same headway.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd
from studies.acc.variants import CARS, CLIMATES_C
from studies.drives import DEFAULT, trip
from studies.road_space.run import EQUAL
from studies.savings import PRODUCTION, road_taken, saved
from studies.session import Session
from studies.whole_trip import drive_whole_trip

import iptm
from iptm_controller.controller import MpcController

OPTIMUM = "optimum of the whole trip at 2 s"
BOTH, FAR = "default at 2 s, perfect preview", "default at up to 120 m, perfect preview"
BRIEF_S = 4.0
BRIEF = f"default at 2 s, perfect preview of {BRIEF_S:g} s"
"""What modes of the lead vehicle with probabilities could be worth at most over these seconds."""
BLIND = "default at 2 s, no preview"
SMOOTHING = "its motion at 2 s, no preview, with the thermostat"
COOLING = "its cooling, no preview, with the motion of `production`"
CYCLES = ("us06", "udds", "wltc_class3b")
WHOLE_S = 600.0
SHORT_S = 60.0
Controls = Mapping[str, tuple[str, Mapping[str, Any], Mapping[str, Any]]]
"""Role, settings and keywords of `drive` by the name of a control, `production` among them."""


class MixedController:
    """Drives by one controller and cools by another; neither is told that its commands are not followed."""

    def __init__(self, motion: MpcController, cooling: MpcController) -> None:
        self._motion, self._cooling = motion, cooling

    def decide(self, measured: iptm.Measurements) -> iptm.Command:
        """Return the acceleration of one and the compressor power of the other."""
        alone = replace(measured, is_followed=False)
        command = self._motion.decide(alone).command
        power_w = self._cooling.decide(alone).command.compressor_power_w
        return replace(command, compressor_power_w=power_w)


def drive(call: Mapping[str, Any], *, whole: bool = False, others: str = "") -> iptm.Run:
    """Drive a trip: as a whole, or with motion or cooling (``others``) by `production`."""
    one = iptm.Trip.of(**call)
    if whole:
        return drive_whole_trip(one)[0]
    if not others:
        return iptm.drive(one)
    base = one.changed(strategy=PRODUCTION)
    own, rules = (MpcController(each.controller_parameters, each.options) for each in (one, base))
    parts = (rules, own) if others == "motion" else (own, rules)
    return iptm.simulate(**call, controller=MixedController(*parts))


def drive_controls(session: Session, controls: Controls) -> pd.DataFrame:
    """Drive every control behind the same leaders; return a row per trip, of `production` as well.

    Returns:
        ``control``, ``cycle``, ``car``, the road taken, what is saved against `production`,
        ``smallest_gap_m`` and ``interventions``.
    """
    length_s = SHORT_S if session.short else WHOLE_S
    cycles, cars = (CYCLES[:1], CARS[:1]) if session.short else (CYCLES, CARS)
    places = list(product(cycles, cars, controls))
    calls = [
        {"call": trip(cycle, role, car, CLIMATES_C[0], **own, duration_s=length_s), **how}
        for cycle, car, name in places
        for role, own, how in [controls[name]]
    ]
    driven = session.compute(drive, calls, ["/".join(place) for place in places])
    found = dict(zip(places, driven, strict=True))
    return pd.DataFrame(
        {
            "control": name,
            "cycle": cycle,
            "car": car,
            **road_taken([run.trajectory]),
            **saved([run.metrics], [base.metrics], run.parameters),
            "smallest_gap_m": float(run.trajectory.gap_m.min()),
            "interventions": float(run.metrics.interventions),
        }
        for (cycle, car, name), run in found.items()
        for base in [found[cycle, car, PRODUCTION]]
        if run is not None and base is not None
    )


def effects(session: Session) -> tuple[pd.DataFrame, dict[str, float]]:
    """Return a row per control, and the shares of the optimum that the default saves in the median."""
    blind = {"preview_mode": "none"}
    rows = drive_controls(
        session,
        {
            PRODUCTION: (PRODUCTION, blind, {}),
            OPTIMUM: (DEFAULT, EQUAL, {"whole": True}),
            FAR: (DEFAULT, {"value_beyond_trip": True}, {}),
            BOTH: (DEFAULT, EQUAL, {}),
            BRIEF: (DEFAULT, {**EQUAL, "preview_length_s": BRIEF_S}, {}),
            BLIND: (DEFAULT, {**EQUAL, **blind}, {}),
            SMOOTHING: (DEFAULT, {**EQUAL, **blind}, {"others": "cooling"}),
            COOLING: (DEFAULT, {**EQUAL, **blind}, {"others": "motion"}),
        },
    )
    rows = rows[rows.control != PRODUCTION]
    by_trip = rows.pivot_table(index=["cycle", "car"], columns="control", values="ageing")
    shares = {
        name: 100.0 * float((by_trip[name] / by_trip[OPTIMUM]).median()) for name in (BOTH, BLIND)
    }
    summed = rows.groupby("control", sort=False)[["headway_s", "ageing", "energy"]]
    table = summed.median().assign(trips=summed.size())
    table["share"] = [shares.get(name, np.nan) for name in table.index]
    return table.reset_index(), shares
