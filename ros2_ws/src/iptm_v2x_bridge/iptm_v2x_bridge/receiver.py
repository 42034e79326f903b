"""The radio link and the receiver on board."""

from __future__ import annotations

import math

import numpy as np

from iptm_core.state import LeaderPreview


def empty_preview() -> LeaderPreview:
    """Return the preview that means "no prediction received yet"; its age is infinite."""
    return LeaderPreview(-math.inf, np.empty(0), np.empty(0), np.empty(0))


class RadioLink:
    """Predictions on their way, delivered a fixed time after they were sent."""

    def __init__(self, latency_ns: int) -> None:
        self._latency_ns = latency_ns
        self._in_flight: list[tuple[int, LeaderPreview]] = []

    def send(self, now_ns: int, preview: LeaderPreview) -> None:
        """Put a prediction on its way."""
        self._in_flight.append((now_ns + self._latency_ns, preview))

    def deliver(self, now_ns: int) -> list[LeaderPreview]:
        """Return what has arrived by now, in order of sending; each prediction once."""
        arrived = [preview for due_ns, preview in self._in_flight if due_ns <= now_ns]
        self._in_flight = [entry for entry in self._in_flight if entry[0] > now_ns]
        return arrived


class Receiver:
    """Holds the latest prediction received, exactly as it was generated.

    Nothing is shifted to the present: the age of a prediction must stay visible to its user.
    """

    def __init__(self) -> None:
        self._latest = empty_preview()

    @property
    def latest(self) -> LeaderPreview:
        """The newest prediction by time of generation; empty before the first reception."""
        return self._latest

    def receive(self, preview: LeaderPreview) -> None:
        """Take a prediction in; an older one than is held already is ignored."""
        if preview.times_s.size and preview.generated_at_s >= self._latest.generated_at_s:
            self._latest = preview
