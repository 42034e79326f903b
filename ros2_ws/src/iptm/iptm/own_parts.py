"""User-supplied objects in place of names: drive, strategy, vehicle, controllers and predictors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from iptm.vehicle import Vehicle
from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.safeguards import CommandLimiter
from iptm_controller.settings import FROM_STRATEGY
from iptm_controller.strategy import COST_TERMS, STRATEGIES, Strategy, strategy_by_name
from iptm_core.decision_record import Rung
from iptm_core.errors import ParameterError, RouteError
from iptm_core.parameters import DEFAULT_SET, ModelParameters, load_parameters, to_flat_dict
from iptm_core.parameters.model import LimitParameters
from iptm_core.routes import Route
from iptm_core.routes.comprehensive import RouteComposition
from iptm_core.routes.cycles import DrivingCycle
from iptm_core.routes.route import UserTrip
from iptm_core.state import NS_PER_S, Command, FloatArray, LeaderPreview, LeaderState
from iptm_core.user_input import StrictMapping, shown
from iptm_v2x_bridge.bridge import CycleSource


@runtime_checkable
class Controller(Protocol):
    """What `simulate` takes as a controller of the user's own."""

    def decide(self, measured: Measurements) -> Command:
        """Return what is actuated until the next tick.

        Args:
            measured: at one instant ``state`` (ego vehicle and pack), ``leader`` (range sensor), ``preview``
                (newest prediction of the leader's motion, possibly empty) and ``slope`` (of the road ahead).

        Returns:
            Acceleration (m/s^2) and compressor power (W, negative for a heater). The loop keeps both
            within the bounds and rates of the vehicle.
        """
        ...


@runtime_checkable
class Predictor(Protocol):
    """What `simulate` takes as a predictor of the leader's motion."""

    def predict(self, leader: LeaderState, times_s: FloatArray) -> FloatArray:
        """Return the speeds that the leader will drive, as they are broadcast to the ego vehicle.

        Args:
            leader: position (m) and speed (m/s) now. Called once per tick, in order of time.
            times_s: trip times, shape (n,), increasing, the first one is now.

        Returns:
            Speeds in m/s, shape (n,), never negative; between the times, speed is linear.
        """
        ...


def check_part(name: str, part: object, protocol: type, method: str) -> None:
    """Refuse what is not None and does not have the method that a part of the user's own needs."""
    if part is not None and (isinstance(part, type) or not isinstance(part, protocol)):
        raise ParameterError(
            f"{name} is {shown(part)}; allowed: an object with the method {method}, see"
            f" iptm.{name.title()}"
        )


class OwnController:
    """A controller of the user's own as the closed loop takes it.

    Attributes:
        options: of which the sampling time counts.
    """

    def __init__(self, inner: Controller, limits: LimitParameters, tick_s: float) -> None:
        self.options = ControllerOptions(tick_s=tick_s)
        self._inner = inner
        self._limiter = CommandLimiter(limits, tick_s)

    def decide(self, measured: Measurements) -> Decision:
        """Return the command of the inner controller, within the bounds of the vehicle.

        Raises:
            ParameterError: it is not a command, or not finite.
        """
        command: Any = self._inner.decide(measured)
        acceleration = _finite(command, "acceleration_m_s2")
        power = _finite(command, "compressor_power_w")
        if acceleration is None or power is None or measured.state is None:
            raise ParameterError(
                f"controller: decide returned {shown(command)}; allowed: iptm.Command of two finite numbers"
            )
        limited, limits = self._limiter.limit(Command(acceleration, power), measured.state)
        return Decision(limited, Rung.OPTIMAL, limits=limits)


class PredictedSource(CycleSource):
    """The leader of a route, with predictions of the user's own."""

    def __init__(self, route: Route, predictor: Predictor) -> None:
        super().__init__(route)
        self._predictor = predictor

    def predict(self, times_s: FloatArray) -> LeaderPreview:
        """Return the prediction made at the first of its times.

        Raises:
            ParameterError: the predictor returned something else than a speed per time.
        """
        now_ns = round(float(times_s[0]) * NS_PER_S)
        leader = self.leader_at(now_ns)
        answer = self._predictor.predict(leader, times_s)
        try:
            speeds = np.asarray(answer, dtype=np.float64)
        except (TypeError, ValueError):
            speeds = np.empty(0)
        if speeds.shape != times_s.shape or not np.all(np.isfinite(speeds) & (speeds >= 0.0)):
            raise ParameterError(
                f"predictor: predict returned {shown(answer)}; allowed: {times_s.size} speeds, 0 m/s or"
                " more"
            )
        steps_m = 0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times_s)
        positions = leader.position_m + np.concatenate([[0.0], np.cumsum(steps_m)])
        return LeaderPreview(times_s, positions, speeds)

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return the true motion of the leader; see `PreviewSource`."""
        return super().predict(times_s)


def _finite(command: Any, name: str) -> float | None:
    """Return an entry of a command; None if it is not a finite number."""
    try:
        value = float(getattr(command, name))
    except (AttributeError, TypeError, ValueError):
        return None
    return value if math.isfinite(value) else None


_BASE = "base"
_OWN_DRIVE = "own drive"
_REFERENCE = "reference_temperature_k"


def flat_settings(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings of a trip with objects replaced by what they stand for.

    Args:
        given: settings by name. ``cycle`` may be a path, a table of columns, a pair of times (s) and speeds
            (m/s) or a `DrivingCycle`; ``strategy`` a `Strategy` or a mapping of ``base`` and weights;
            ``vehicle`` an `iptm.Vehicle`, a parameter set by name or path, `ModelParameters` or a mapping of
            parameters, and ``base`` for a set other than the default. It sets ``parameter_set`` and
            ``overrides``; stated overrides come after it.

    Raises:
        IptmError: a value is not usable; the message states the value and what is allowed.
    """
    settings = {key: _plain(value) for key, value in given.items()}
    if "cycle" in settings:
        settings |= _drive(settings["cycle"])
    if "strategy" in settings:
        settings |= _strategy(settings["strategy"])
    if settings.get("vehicle") is not None:
        parameter_set, changes = _vehicle(settings.pop("vehicle"))
        over = settings.get("overrides") or {}
        settings["parameter_set"] = parameter_set
        if changes and not isinstance(over, Mapping):
            raise ParameterError(
                f"overrides is {shown(over)} beside a vehicle with parameters; allowed: a mapping"
            )
        settings["overrides"] = {**changes, **over} if changes else over
    settings.pop("vehicle", None)
    overrides = settings.get("overrides")
    if not isinstance(overrides, (Mapping, str, type(None))):
        raise ParameterError(
            f"overrides is {shown(overrides)}; allowed: a mapping of key and number"
        )
    return settings


def _plain(value: Any) -> Any:
    """Return a number of NumPy's as a plain one."""
    return value.item() if isinstance(value, np.generic) else value


def _drive(cycle: Any) -> dict[str, Any]:
    """Return the name of a cycle, and the drive itself where it is neither a name nor a file."""
    if isinstance(cycle, (str, Path)):
        return {"cycle": str(cycle)}
    if isinstance(cycle, (UserTrip, RouteComposition)):
        return {"cycle": _OWN_DRIVE, "own_drive": cycle}
    if isinstance(cycle, DrivingCycle):
        return {"cycle": cycle.name, "own_drive": UserTrip(cycle, None)}
    if hasattr(cycle, "to_numpy") and hasattr(cycle, "columns"):
        index = cycle.index.name
        cycle = cycle.reset_index() if index is not None and index not in cycle else cycle
        columns = {str(name): cycle[name].to_numpy() for name in cycle}
    elif isinstance(cycle, Mapping):
        columns = {str(name): values for name, values in cycle.items()}
    elif isinstance(cycle, (tuple, list)) and len(cycle) == 2 and np.ndim(cycle[0]) == 1:
        columns = {"time_s": cycle[0], "speed_m_s": cycle[1]}
    else:
        raise RouteError(
            f"cycle is {shown(cycle)}; allowed: a name, a path, a DataFrame or mapping with time_s and a"
            " speed, or times in s and speeds in m/s"
        )
    from iptm_core.routes.user_csv import trip_from_columns  # noqa: PLC0415

    return {"cycle": _OWN_DRIVE, "own_drive": trip_from_columns(columns, _OWN_DRIVE)}


def _strategy(given: Any) -> dict[str, Any]:
    """Return the settings of a strategy: the name of a shipped one, and the weights in which it differs."""
    if isinstance(given, str):
        return {"strategy": strategy_by_name(given).name}
    if isinstance(given, Mapping):
        names = (_BASE, *COST_TERMS, _REFERENCE, "cost_to_go")
        written = StrictMapping(given, "strategy", names, error=ParameterError)
        base = strategy_by_name(written.text(_BASE))
        given = replace(base, **{key: given[key] for key in written if key != _BASE})
    if not isinstance(given, Strategy):
        raise ParameterError(
            f"strategy is {shown(given)}; allowed: a name, iptm.Strategy, or a mapping of base and weights"
        )
    kind = (given.cost_to_go, given.rules)
    alike = [each for each in STRATEGIES.values() if (each.cost_to_go, each.rules) == kind]
    base = STRATEGIES.get(given.name, alike[-1])
    base = base if base in alike else alike[-1]
    stated = {
        key: getattr(given, key) if getattr(given, key) != getattr(base, key) else FROM_STRATEGY
        for key in (*COST_TERMS, _REFERENCE)
    }
    return {"strategy": base.name, **stated}


def _vehicle(vehicle: Any) -> tuple[str, dict[str, Any]]:
    """Return a parameter set and what differs from it."""
    if isinstance(vehicle, (str, Path)):
        return str(vehicle), {}
    if isinstance(vehicle, Vehicle):
        return vehicle.name, dict(vehicle.overrides)
    if isinstance(vehicle, ModelParameters):
        usual = to_flat_dict(load_parameters().values)
        flat = to_flat_dict(vehicle)
        return DEFAULT_SET, {key: flat[key] for key in flat if flat[key] != usual[key]}
    if isinstance(vehicle, Mapping):
        content = dict(vehicle)
        return str(content.pop(_BASE, DEFAULT_SET)), dict(_flat(content))
    raise ParameterError(
        f"vehicle is {shown(vehicle)}; allowed: iptm.Vehicle, a parameter set, the path of a .yaml file, or a"
        " mapping of parameters"
    )


def _flat(content: Mapping[Any, Any], group: str = "") -> Iterator[tuple[str, Any]]:
    """Yield dotted keys and numbers of ``{"body": {"mass_kg": 1600}}`` and ``{"body.mass_kg": 1600}``."""
    for key, value in content.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{group}{key}.")
        else:
            yield f"{group}{key}", _plain(value)
