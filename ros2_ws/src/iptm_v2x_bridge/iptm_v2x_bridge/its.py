"""What an extra adds: verified signatures, roadside stations, captures, the chain of vehicles ahead.

Its module ``extra_v2x`` has the functions `read_capture`, `verifier`, `roadside_rules` and `chain`.
"""

from __future__ import annotations

from typing import Any, Protocol

from iptm_core.errors import ParameterError
from iptm_core.extras import offered
from iptm_v2x_bridge.bridge import TickBridge
from iptm_v2x_bridge.messages.packets import OpenedDatagram
from iptm_v2x_bridge.prediction.road_rules import RoadRules
from iptm_v2x_bridge.rejections import Rejection, RejectionCounts

CAPTURE_SUFFIXES = (".pcap", ".pcapng", ".cap")


class Verification(Protocol):
    """Decides by its signature whether a message is accepted."""

    def forget(self) -> None:
        """Forget signers and counts."""

    def check(self, opened: OpenedDatagram, now_ms: int) -> Rejection | None:
        """Return why a message is refused at a TimestampIts (ms), None if it is not."""

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        ...


class Unverified:
    """Accepts every message, and counts the signed ones."""

    def __init__(self) -> None:
        self._signed = 0

    def forget(self) -> None:
        """Begin to count again."""
        self._signed = 0

    def check(self, opened: OpenedDatagram, now_ms: int) -> Rejection | None:  # noqa: ARG002
        """Return None."""
        self._signed += opened.secured
        return None

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return {"signatures_verified": 0, "signatures_not_verified": self._signed}


class RoadsideRules(Protocol):
    """Rules of the road as roadside stations send them.

    Attributes:
        ego: for an ego vehicle that keeps them.
        leader: for the prediction of a leader.
        rejections: messages that were refused.
    """

    ego: RoadRules
    leader: RoadRules
    rejections: RejectionCounts

    def forget(self) -> None:
        """Forget everything that was heard."""

    def receive(self, opened: OpenedDatagram, now_ms: int) -> None:
        """Take in a message at a TimestampIts (ms)."""

    def decode(self, now_ms: int) -> None:
        """Decode what waits."""

    def refresh(self, now_ms: int, ego_position_m: float) -> None:
        """Bring the rules up to date."""

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        ...


class ReportingBridge(TickBridge, Protocol):
    """A bridge that reports."""

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        ...


def extra_for(setting: str, value: object) -> Any:
    """Return the module of the extra that a setting needs.

    Raises:
        ParameterError: none is installed.
    """
    for module in offered("v2x"):
        return module
    raise ParameterError(
        f"{setting} is {value!r}, but no extra of the V2X bridge is installed; allowed: "
        f"{type(value)()!r}, or with one"
    )
