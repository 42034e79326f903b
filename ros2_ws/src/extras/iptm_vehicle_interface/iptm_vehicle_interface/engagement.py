"""Engagement: an explicit state machine, a row per transition.

| from | to | when |
|---|---|---|
| off | ready | nothing hinders |
| ready | off | something hinders |
| ready | engaged | the enable button is pressed anew, no pedal is |
| engaged, overridden | ready | brake or cancel: in the next frame |
| engaged | overridden | accelerator |
| overridden | engaged | accelerator released |
| engaged, overridden | hand-over | something hinders |
| hand-over | off | the ramp has ended, or the driver brakes |
| engaged, overridden, hand-over | off | a process of the suite has stopped: in the next frame |

During the hand-over a request to brake is released at a stated rate and a warning is shown; a request to
accelerate ends at once. After it the driver has to enable again.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from iptm_core.decision_record import DrivingMode

HAND_OVER_RATE_M_S3 = 1.0
"""Rate at which braking is released during the hand-over."""
ACTIVE = frozenset({DrivingMode.ENGAGED, DrivingMode.HAND_OVER})
"""Modes in which requests are sent."""


@dataclass(frozen=True)
class EngagementConditions:
    """What the state machine looks at.

    Attributes:
        hindrance: why the suite cannot drive; empty for nothing.
        stopped: which process of the suite has stopped, in words; empty for none.
    """

    brake: bool = False
    accelerator: bool = False
    enable: bool = False
    cancel: bool = False
    hindrance: str = ""
    stopped: str = ""


@dataclass(frozen=True)
class Engagement:
    """The state, and what it carries.

    Attributes:
        reason: of the last change, for the driver.
        enable_was_pressed: the button of the step before; pressing it for long enables once.
        released_m_s2: acceleration requested during the hand-over.
    """

    mode: DrivingMode = DrivingMode.OFF
    reason: str = "start"
    enable_was_pressed: bool = True
    released_m_s2: float = 0.0

    @property
    def is_active(self) -> bool:
        """Whether requests are sent."""
        return self.mode in ACTIVE

    def step(
        self, now: EngagementConditions, requested_m_s2: float, duration_s: float
    ) -> Engagement:
        """Return the state one step later.

        Args:
            requested_m_s2: acceleration that was requested last.
            duration_s: time since the step before.
        """
        if self.mode in {DrivingMode.OFF, DrivingMode.READY}:
            after = self._waiting(now)
        else:
            after = self._driving(now, requested_m_s2, duration_s)
        return replace(after, enable_was_pressed=now.enable)

    def _waiting(self, now: EngagementConditions) -> Engagement:
        """Return the state after off and ready."""
        if now.stopped or now.hindrance:
            return replace(self, mode=DrivingMode.OFF, reason=now.stopped or now.hindrance)
        if self.mode is DrivingMode.OFF:
            return replace(self, mode=DrivingMode.READY, reason="ready")
        pressed = now.enable and not self.enable_was_pressed
        if pressed and not (now.brake or now.accelerator or now.cancel):
            return replace(self, mode=DrivingMode.ENGAGED, reason="enabled by the driver")
        return self

    def _driving(
        self, now: EngagementConditions, requested_m_s2: float, duration_s: float
    ) -> Engagement:
        """Return the state after engaged, overridden and hand-over."""
        if now.brake or now.cancel:
            reason = "the driver brakes" if now.brake else "cancelled by the driver"
            mode = DrivingMode.OFF if self.mode is DrivingMode.HAND_OVER else DrivingMode.READY
            return replace(self, mode=mode, reason=reason)
        if now.stopped:
            return replace(self, mode=DrivingMode.OFF, reason=now.stopped)
        if self.mode is DrivingMode.HAND_OVER:
            eased = self.released_m_s2 + HAND_OVER_RATE_M_S3 * duration_s
            if eased >= 0.0 or now.accelerator:
                return replace(self, mode=DrivingMode.OFF, released_m_s2=0.0)
            return replace(self, released_m_s2=eased)
        if now.hindrance:
            braking = min(requested_m_s2, 0.0) if self.mode is DrivingMode.ENGAGED else 0.0
            return replace(
                self, mode=DrivingMode.HAND_OVER, reason=now.hindrance, released_m_s2=braking
            )
        if now.accelerator:
            return replace(self, mode=DrivingMode.OVERRIDDEN, reason="the driver accelerates")
        if self.mode is DrivingMode.OVERRIDDEN:
            return replace(self, mode=DrivingMode.ENGAGED, reason="accelerator released")
        return self
