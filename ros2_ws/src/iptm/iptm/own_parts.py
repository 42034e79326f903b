"""Controllers and predictors of the user's own in the closed loop."""

from __future__ import annotations

import math
from typing import Any, Protocol, runtime_checkable

import numpy as np

from iptm_controller.decision import Decision
from iptm_controller.measurements import Measurements
from iptm_controller.options import ControllerOptions
from iptm_controller.safeguards import CommandLimiter
from iptm_core.decision_record import Rung
from iptm_core.errors import ParameterError
from iptm_core.parameters.model import LimitParameters
from iptm_core.routes import Route
from iptm_core.state import NS_PER_S, Command, FloatArray, LeaderPreview, LeaderState
from iptm_core.user_input import shown
from iptm_v2x_bridge.bridge import CycleSource


@runtime_checkable
class Controller(Protocol):
    """What `simulate` takes as a controller of the user's own."""

    def decide(self, measured: Measurements) -> Command:
        """Return the command until the next tick.

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
