"""Who may drive, by the gateway's own readings: given by the driver's button alone, lost in one frame.

The suite learns by a `GatewayReport` on the bus between both, and states there which decision it follows.
These frames are private to that bus and never reach the car.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from iptm_core.declaration import TextEnum
from iptm_core.signal_residuals import Contradiction

ARMED_S = 1.0
"""Enabling without a request counts for this long."""
REPORT_TIMEOUT_S = 0.1
REPORT_ID, DECISION_ID, BENCH_BUTTON_ID = 0x1FFFFF00, 0x1FFFFF01, 0x1FFFFF02
_DECISIONS = 1 << 32


class Loss(TextEnum):
    """Why the suite has no authority. A report carries the place of a reason here."""

    NOT_ENABLED = "the driver has not enabled"
    BRAKE = "the driver brakes"
    CANCEL = "cancelled by the driver"
    DOOR = "a door is open"
    FAULT = "the vehicle reports a fault"
    CRUISE = "the cruise control of the car is off"
    STALE = "no fresh reading of speed, brake or gap"
    AGE = "command too old"
    NOT_FINITE = "command is not a number"
    LET_GO = "the suite has let go"
    RIVAL = "another sender of the command"
    UNCONFIRMED = "the car does not act on requests"
    DECISION = "no new decision"
    RANGE = Contradiction.RANGE.value
    SPEED = Contradiction.SPEED.value


_LOSSES = tuple(Loss)


@dataclass(frozen=True)
class Readings:
    """What the gateway reads at an instant.

    Attributes:
        button: whether the driver presses the button.
        cruise: whether the car's own cruise control is on.
        accelerator: whether the driver accelerates: the request does not count, the authority stays.
        requested: whether the suite asks to drive.
        loss: why it may not; None for nothing.
    """

    button: bool = False
    cruise: bool = False
    accelerator: bool = False
    requested: bool = False
    loss: Loss | None = None


@dataclass(frozen=True)
class Authority:
    """Whether the suite may drive.

    Attributes:
        is_armed: it may.
        is_pressed: the button went down and is not released yet; its release enables.
        loss: why it may not.
        since_s: of enabling, or of the newest request or overriding.
        before: readings of the step before; what is pressed or on at the start has to be so anew.
    """

    is_armed: bool = False
    is_pressed: bool = False
    loss: Loss = Loss.NOT_ENABLED
    since_s: float = 0.0
    before: Readings = Readings(button=True, cruise=True)

    def step(self, now: Readings, now_s: float) -> Authority:
        """Return the state at an instant."""
        before = self.before
        goes_down = now.button and not before.button
        is_released = self.is_pressed and not now.button
        is_pressed = now.button and (self.is_pressed or goes_down)
        after = replace(self, before=now, is_pressed=is_pressed)
        if now.loss is not None:
            # What ended a drive stays named until the driver enables anew.
            loss = now.loss if self.is_armed or now.loss is not Loss.STALE else self.loss
            return replace(after, is_armed=False, loss=loss)
        is_on = now.cruise and not before.cruise
        if (is_released or is_on) and not now.accelerator:
            return replace(after, is_armed=True, since_s=now_s)
        if not self.is_armed:
            return after
        if now.requested or now.accelerator:
            return replace(after, since_s=now_s)
        if before.requested and not before.accelerator:
            return replace(after, is_armed=False, loss=Loss.LET_GO)
        if now_s - self.since_s > ARMED_S:
            return replace(after, is_armed=False, loss=Loss.NOT_ENABLED)
        return after


@dataclass(frozen=True)
class GatewayReport:
    """What the gateway reports to the suite.

    Attributes:
        is_armed: whether the suite may drive.
        is_active: whether its requests reach the car.
        loss: why it may not.
    """

    is_armed: bool
    is_active: bool
    loss: Loss


def report_frame(report: GatewayReport) -> tuple[int, bytes]:
    """Return a report as a frame."""
    flags = report.is_armed | report.is_active << 1
    return REPORT_ID, bytes([flags, _LOSSES.index(report.loss)])


def read_report(data: bytes) -> GatewayReport | None:
    """Return the report of a frame, None for one that is malformed."""
    if len(data) != 2 or data[1] >= len(_LOSSES):
        return None
    return GatewayReport(bool(data[0] & 1), bool(data[0] & 2), _LOSSES[data[1]])


def decision_frame(number: int) -> tuple[int, bytes]:
    """Return the frame that states how many decisions were made."""
    return DECISION_ID, (number % _DECISIONS).to_bytes(4, "big")
