"""Frames of a CAN bus: decoded into SI values with their faults, and encoded with counter and checksum.

Signals arrive at 1 to 100 Hz and are seen at one instant: the newest value of each with its age.

The checksum is the sum of the identifier's bytes and of all bytes of the frame but its own, inverted, in its
lowest bits. A vehicle with another one is a vehicle with another function here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from iptm_core.declaration import TextEnum
from iptm_core.errors import MessageError
from iptm_vehicle_interface.vehicle import CommandTarget, SignalSource, Vehicle


class FrameFault(TextEnum):
    """Why a frame does not count."""

    LENGTH = "shorter than the DBC states"
    CHECKSUM = "wrong checksum"
    COUNTER = "repeated counter"


@dataclass(frozen=True)
class Decoded:
    """What a frame carries.

    Attributes:
        message: name in the DBC; empty for a frame that the vehicle is not mapped to.
        values: SI values by the name of `SIGNALS`; what the DBC's range excludes is missing.
        fault: None where the frame counts.
    """

    message: str = ""
    values: Mapping[str, float] = field(default_factory=dict)
    fault: FrameFault | None = None


def checksum_of(frame_id: int, data: bytes, bits: int) -> int:
    """Return the checksum of a frame whose own checksum bits are 0."""
    total = sum(frame_id.to_bytes(4, "big")) + sum(data)
    return ~total & ((1 << bits) - 1)


class FrameCodec:
    """Decodes and encodes the frames of a vehicle; remembers counters, so one per direction and process."""

    def __init__(self, vehicle: Vehicle) -> None:
        self.vehicle = vehicle
        self._by_message: dict[str, list[tuple[str, SignalSource]]] = {}
        for name, source in vehicle.signals.items():
            self._by_message.setdefault(source.message, []).append((name, source))
        self._messages = {each.frame_id: each for each in vehicle.database.messages}
        self._protected = {
            each.name: {s.name: s for s in each.signals} for each in self._messages.values()
        }
        self._received: dict[str, int] = {}
        self._sent: dict[str, int] = {}

    def decode(self, frame_id: int, data: bytes) -> Decoded:
        """Return what a frame carries, or why it does not count."""
        message = self._messages.get(frame_id)
        if message is None or message.name not in self._by_message:
            return Decoded()
        raw, fault = self._checked(message, data)
        if fault is not None:
            return Decoded(message.name, fault=fault)
        values = {}
        for name, source in self._by_message[message.name]:
            value = float(raw[source.signal])
            signal = self._protected[message.name][source.signal]
            low = -float("inf") if signal.minimum is None else signal.minimum
            high = float("inf") if signal.maximum is None else signal.maximum
            if low <= value <= high:
                values[name] = source.to_si(value)
        return Decoded(message.name, values)

    def command(self, frame_id: int, data: bytes) -> tuple[CommandTarget, float, bool] | None:
        """Return which command a frame is, its SI value and whether it is enabled; None for another frame.

        Raises:
            MessageError: the frame is a command and does not count.
        """
        message = self._messages.get(frame_id)
        targets = (self.vehicle.acceleration, self.vehicle.compressor)
        target = next(
            (t for t in targets if message is not None and t and t.message == message.name), None
        )
        if message is None or target is None:
            return None
        raw, fault = self._checked(message, data)
        if fault is not None:
            raise MessageError(f"{message.name}: {fault.value}")
        value = float(raw[target.signal]) * target.factor + target.offset
        return target, value, bool(raw[target.enable]) if target.enable else True

    def encode(self, message_name: str, values: Mapping[str, float]) -> tuple[int, bytes]:
        """Return identifier and bytes of a message, with the next counter and its checksum.

        Args:
            values: in the units of the DBC, by the name of the signal; the others are 0.

        Raises:
            MessageError: a value does not fit into its signal.
        """
        message = self.vehicle.database.get_message_by_name(message_name)
        signals = self._protected[message_name]
        full = dict.fromkeys(signals, 0.0) | dict(values)
        protection = self.vehicle.protection
        if protection.counter in signals:
            count = (self._sent.get(message_name, -1) + 1) % (
                1 << signals[protection.counter].length
            )
            self._sent[message_name] = count
            full[protection.counter] = count
        try:
            data = message.encode(full, strict=True)
            if protection.checksum in signals:
                bits = signals[protection.checksum].length
                full[protection.checksum] = checksum_of(message.frame_id, data, bits)
                data = message.encode(full, strict=True)
        except Exception as error:
            raise MessageError(f"{message_name} cannot carry {dict(values)}: {error}") from error
        return message.frame_id, data

    def encode_command(
        self, target: CommandTarget, value: float, *, enabled: bool
    ) -> tuple[int, bytes]:
        """Return the frame of a command in SI units; a value beyond the signal's range is cut to it."""
        signal = self._protected[target.message][target.signal]
        in_dbc = target.from_si(value)
        if signal.minimum is not None and signal.maximum is not None:
            in_dbc = min(max(in_dbc, signal.minimum), signal.maximum)
        values = {target.signal: in_dbc}
        if target.enable:
            values[target.enable] = float(enabled)
        return self.encode(target.message, values)

    def _checked(self, message: Any, data: bytes) -> tuple[Mapping[str, Any], FrameFault | None]:
        """Return raw values by signal, and the fault of length, checksum or counter."""
        if len(data) < message.length:
            return {}, FrameFault.LENGTH
        raw = message.decode(data, decode_choices=False)
        signals, protection = self._protected[message.name], self.vehicle.protection
        if protection.checksum in signals:
            without = message.encode({**raw, protection.checksum: 0}, strict=False)
            bits = signals[protection.checksum].length
            if int(raw[protection.checksum]) != checksum_of(message.frame_id, without, bits):
                return raw, FrameFault.CHECKSUM
        if protection.counter in signals:
            count = int(raw[protection.counter])
            if self._received.get(message.name) == count:
                return raw, FrameFault.COUNTER
            self._received[message.name] = count
        return raw, None


class SignalTable:
    """Values and times of arrival; a value older than its timeout is NaN."""

    def __init__(self, sources: Mapping[str, SignalSource]) -> None:
        self._timeouts_s = {name: source.timeout_s for name, source in sources.items()}
        self._values: dict[str, tuple[float, float]] = {}

    def take(self, values: Mapping[str, float], time_s: float) -> None:
        """Take values that arrived at one time, which is not decreasing."""
        for name, value in values.items():
            self._values[name] = value, time_s

    def age_s(self, name: str, now_s: float) -> float:
        """Return the age of a signal, infinite where it never arrived."""
        entry = self._values.get(name)
        return math.inf if entry is None else now_s - entry[1]

    def value(self, name: str, now_s: float) -> float:
        """Return a signal, NaN where it is stale, never arrived or is not offered."""
        entry = self._values.get(name)
        if entry is None or now_s - entry[1] > self._timeouts_s[name]:
            return math.nan
        return entry[0]

    def is_set(self, name: str, now_s: float) -> bool:
        """Return whether a fresh flag is 1; an unknown one is not set."""
        return self.value(name, now_s) >= 0.5

    def stale(self, names: Iterable[str], now_s: float) -> tuple[str, ...]:
        """Return which of several signals are offered by the vehicle and not fresh."""
        return tuple(
            name
            for name in names
            if name in self._timeouts_s and math.isnan(self.value(name, now_s))
        )


MISSING_CHANGE_M = 0.3
"""Change of the gap by the measured relative speed that is missing when a sensor counts as frozen."""
LEAST_REPEATS = 2
"""Noise makes up for the change between two measurements now and then."""
LONGEST_SAME_S = 2.0
"""Longer than this no gap in motion is measured the same, noise and resolution included."""
MOVING_M_S = 2.0


class RangeWatch:
    """Notices a range sensor that repeats itself with sound counters."""

    def __init__(self) -> None:
        self._measured: tuple[float, float] | None = None
        self._arrivals_s: list[float] = []

    def is_frozen(self, gap_m: float, relative_m_s: float, speed_m_s: float, now_s: float) -> bool:
        """Return whether the sensor repeats a measurement that must have changed; NaN for no target.

        Args:
            now_s: when the measurement arrived: one that is lost is none that is repeated.
        """
        if (gap_m, relative_m_s) != self._measured or not speed_m_s >= MOVING_M_S:
            self._measured, self._arrivals_s = (gap_m, relative_m_s), [now_s]
            return False
        if now_s > self._arrivals_s[-1] + 1e-3:  # ages are differences of large numbers
            self._arrivals_s.append(now_s)
        unchanged_s = now_s - self._arrivals_s[0]
        if len(self._arrivals_s) <= LEAST_REPEATS:
            return False
        return unchanged_s > LONGEST_SAME_S or abs(relative_m_s) * unchanged_s > MISSING_CHANGE_M
