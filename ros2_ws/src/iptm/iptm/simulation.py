"""The short spelling of a trip in memory, for notebooks."""

from __future__ import annotations

from typing import Any

from iptm.driving import drive_in_memory
from iptm.own_parts import Controller, Predictor
from iptm.progress_line import ProgressLine
from iptm.run import Run
from iptm.trip import Trip
from iptm_core.aging_laws.law import AgingLaw
from iptm_core.settings import TripSettings


def simulate(
    cycle: Any = TripSettings.cycle,
    *,
    vehicle: Any = None,
    aging_law: Any = None,
    controller: Controller | None = None,
    predictor: Predictor | None = None,
    **settings: Any,
) -> Run:
    """Drive a trip behind a lead vehicle, without ROS: ``drive(Trip.of(cycle, **settings))``.

    The defaults match ``scripts/run_demo``, and both give the same commands. On a terminal and in a
    notebook a line shows how far a longer drive has come.

    Args:
        cycle: what the lead vehicle drives: a name such as ``wltc_class3b``, the path of a drive (CSV, GPX,
            SUMO, bag), a DataFrame or mapping with ``time_s`` and one of ``speed_m_s``, ``speed_kmh`` and
            ``speed_mph``, optionally ``elevation_m`` or ``slope_percent``, or a pair of times (s) and speeds
            (m/s).
        vehicle: a car or parameter set by name or path, `Vehicle`, `ModelParameters`, or a mapping of dotted
            keys and numbers, with ``base`` for a set other than the default.
        aging_law: law of the controller's cost: ``paper``, a cell such as ``nca``, or an `AgingLaw`.
        controller: drives instead of the controller of the suite, see `Controller`; strategy and horizon then
            do not count.
        predictor: predicts the lead vehicle for the controller instead of its true future, see `Predictor`.
        settings: all other settings of a trip by their names: ``strategy`` (a name, a `Strategy` or a
            mapping of ``base`` and weights), ``horizon``, ``overrides`` (parameters by dotted key),
            ``climate`` (a name or degC), ``slope``, ``duration_s``, ``latency_s``, ``leader_source``,
            ``faults`` ...

    Returns:
        The finished run.

    Raises:
        IptmError: an argument is not usable; the message states the value and what is allowed.
    """
    own_law = aging_law if isinstance(aging_law, AgingLaw) else None
    named = {} if own_law is not None or aging_law is None else {"aging_law": aging_law}
    if vehicle is not None:
        named["vehicle"] = vehicle
    trip = Trip.of(cycle, **settings, **named)
    ticks = round(trip.route.duration_s / trip.conditions.period_s)
    with ProgressLine(trip.heading, ticks + 1) as line:
        return drive_in_memory(
            trip, controller=controller, predictor=predictor, aging_law=own_law, on_step=line.step
        )
