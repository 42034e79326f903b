"""A trip driven on the headless loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from iptm.inputs import run_inputs, settings_of
from iptm.own_parts import Controller, OwnController, PredictedSource, Predictor
from iptm.run import Run
from iptm.studies.run import Run as StudyRun
from iptm.studies.run import perform_run
from iptm_controller.settings import ControllerSettings
from iptm_controller.strategy import DEFAULT_STRATEGY
from iptm_core.aging_laws.law import AgingLaw
from iptm_core.aging_laws.parking import PAPER_LAW
from iptm_core.decision_record import DecisionSeries
from iptm_core.errors import ParameterError
from iptm_core.parameters import DEFAULT_SET
from iptm_core.routes.slope import SlopeProfile
from iptm_core.settings import LeaderSource, TripSettings
from iptm_core.user_input import shown

_OWN = "own"


def simulate(
    cycle: Any = TripSettings.cycle,
    *,
    strategy: Any = DEFAULT_STRATEGY,
    horizon: str = ControllerSettings.horizon,
    vehicle: Any = DEFAULT_SET,
    aging_law: Any = PAPER_LAW,
    overrides: Mapping[str, float] | None = None,
    controller: Controller | None = None,
    predictor: Predictor | None = None,
    leader: str | None = LeaderSource.CYCLE.value,
    **settings: Any,
) -> Run:
    """Drive a trip behind a lead vehicle, without ROS.

    The defaults are those of ``scripts/run_demo``, and both give the same commands.

    Args:
        cycle: what the lead vehicle drives: a name such as ``wltc_class3b``, the path of a drive (CSV, GPX,
            SUMO, bag), a DataFrame or mapping with ``time_s`` and one of ``speed_m_s``, ``speed_kmh`` and
            ``speed_mph``, optionally ``elevation_m`` or ``slope_percent``, or a pair of times (s) and speeds
            (m/s).
        strategy: cost terms and weights: a name, a `Strategy`, or a mapping of ``base`` and weights.
        horizon: prediction grid, such as ``3x1+5x5``.
        vehicle: a parameter set by name or path, `ModelParameters`, or a mapping of dotted keys and numbers,
            with ``base`` for a set other than the default.
        overrides: single parameters that differ, by dotted key.
        aging_law: law of the controller's cost: ``paper``, a cell such as ``nca``, or an `AgingLaw`. Use of
            the car and prices are settings: ``parking_air_k``, ``charging_target`` and others of
            `AgingSettings`.
        controller: drives instead of the controller of the suite, see `Controller`; strategy and horizon then
            do not count.
        predictor: predicts the lead vehicle for the controller instead of its true future, see `Predictor`.
        leader: ``cycle``, or None for an empty road, on which the ego vehicle drives the road of the cycle at
            its limits; ``speed_limits_km_h`` (``"cycle"`` takes those that the cycle suggests) or
            ``set_speed_km_h`` is needed then.
        settings: further keys of a run in a study: ``slope``, ``duration_s``, ``preview``, ``solver``,
            ``thermal_model``, ``tick_s``, ``plant_step_s``, ``faults``, ``signals``, ``ego_keeps_rules``,
            and ``charging_minute_kwh`` with the others of a stop at a fast charger.

    Returns:
        The finished run.

    Raises:
        IptmError: an argument is not usable; the message states the value and what is allowed.
    """
    for name, part, protocol, method in (
        ("controller", controller, Controller, "decide"),
        ("predictor", predictor, Predictor, "predict"),
    ):
        if part is not None and (isinstance(part, type) or not isinstance(part, protocol)):
            raise ParameterError(
                f"{name} is {shown(part)}; allowed: an object with the method {method}, see"
                f" iptm.{name.title()}"
            )
    if leader is not None and not isinstance(leader, str):
        raise ParameterError(f"leader is {shown(leader)}; allowed: cycle or None")
    own_law = aging_law if isinstance(aging_law, AgingLaw) else None
    settings |= {
        "horizon": horizon,
        "aging_law": PAPER_LAW if own_law else aging_law,
        "leader_source": leader or LeaderSource.NONE.value,
    }
    inputs = run_inputs(cycle, strategy, vehicle, overrides, settings)
    own = (
        None
        if controller is None
        else OwnController(controller, inputs.parameters.limits, inputs.spec.tick_s)
    )
    source = None if predictor is None else PredictedSource(inputs.route, predictor)
    done = perform_run(inputs, own_controller=own, leader=source, own_law=own_law)
    run = run_of_study(done, inputs.route.slope)
    if controller is not None:
        own_settings = {"strategy": _OWN, "horizon": _OWN, "solver": _OWN}
        # Strategy and horizon are those of the controller that did not drive.
        planned = f", {inputs.spec.horizon}, {inputs.spec.strategy.name}"
        run = replace(run, name=run.name.replace(planned, ""))
        run = _with_own(run, f"controller {type(controller).__name__}", own_settings)
    if own_law is not None:
        run = _with_own(run, f"law {own_law.name}", {"aging_law": own_law.name})
    if predictor is not None:
        name = type(predictor).__name__
        run = _with_own(run, f"predictor {name}", {"predictor": name})
    return run


def run_of_study(done: StudyRun, slope: SlopeProfile | None = None) -> Run:
    """Return a run of a study as one of the library."""
    return Run(
        name=done.spec.describe(),
        settings=settings_of(done.spec),
        parameters=done.parameters,
        trajectory=done.trajectory,
        decisions=done.decisions or DecisionSeries.from_records([], []),
        slope=slope,
        reports=done.reports,
    )


def _with_own(run: Run, what: str, settings: Mapping[str, Any]) -> Run:
    return replace(run, name=f"{run.name}, {what}", settings={**run.settings, **settings})
