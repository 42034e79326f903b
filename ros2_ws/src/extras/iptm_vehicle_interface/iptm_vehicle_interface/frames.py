"""Frames of a CAN bus: decoded into SI values with their faults, and encoded with counter and checksum.

Signals arrive at 1 to 100 Hz and are seen at one instant: the newest value of each with its age.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from iptm_core.errors import MessageError
from iptm_core.signal_residuals import Contradiction, SignalWatch
from iptm_vehicle_interface.channel import CommandTarget, SignalSource, VehicleLink
from iptm_vehicle_interface.protection import CounterWatch, FrameFault, Protection

UNPROTECTED = Protection()


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


class FrameCodec:
    """Decodes and encodes the frames of a vehicle; remembers counters, so one per direction and process."""

    def __init__(self, vehicle: VehicleLink) -> None:
        self.vehicle = vehicle
        self._by_message: dict[str, list[tuple[str, SignalSource]]] = {}
        for name, source in vehicle.signals.items():
            self._by_message.setdefault(source.message, []).append((name, source))
        self._messages = {
            (vehicle.buses[name], each.frame_id): each for name, each in vehicle.messages.items()
        }
        self._signals = {
            name: {signal.name: signal for signal in each.signals}
            for name, each in vehicle.messages.items()
        }
        self._targets = {target.message: target for target in vehicle.commands}
        repeated = {message for each in vehicle.commands for message, _ in each.copied.values()}
        self._heard = {*self._by_message, *repeated}
        self._copied: dict[tuple[str, str], float] = {}
        self._received: dict[str, CounterWatch] = {}
        self._sent: dict[str, int] = {}

    def decode(self, frame_id: int, data: bytes, bus: int = 0) -> Decoded:
        """Return what a frame carries, or why it does not count."""
        message = self._messages.get((bus, frame_id))
        if message is None or message.name not in self._heard:
            return Decoded()
        raw, fault = self._checked(message, data)
        if fault is not None:
            return Decoded(message.name, fault=fault)
        for target in self.vehicle.commands:
            for place in target.copied.values():
                if place[0] == message.name:
                    self._copied[place] = float(raw[place[1]])
        values = {}
        for name, source in self._by_message.get(message.name, ()):
            value = float(raw[source.signal])
            signal = self._signals[message.name][source.signal]
            low = -math.inf if signal.minimum is None else signal.minimum
            high = math.inf if signal.maximum is None else signal.maximum
            if low <= value <= high:
                values[name] = source.to_si(value)
        return Decoded(message.name, values)

    def command(
        self, frame_id: int, data: bytes, bus: int | None = None
    ) -> tuple[CommandTarget, float, bool] | None:
        """Return which command a frame is, its SI value and whether it is enabled; None for another frame.

        Raises:
            MessageError: the frame is a command and does not count.
        """
        route = self.vehicle.route(frame_id)[0]
        message = self._messages.get((route, frame_id)) if bus in {None, route} else None
        target = None if message is None else self._targets.get(message.name)
        if message is None or target is None:
            return None
        raw, fault = self._checked(message, data)
        if fault is not None:
            raise MessageError(f"{message.name}: {fault.value}")
        return target, target.to_si(float(raw[target.signal])), target.is_enabled(raw)

    def encode(self, message_name: str, values: Mapping[str, float]) -> tuple[int, bytes]:
        """Return identifier and bytes of a message, with the next counter and its checksum.

        Args:
            values: in the units of the DBC, by the name of the signal; the bits of the others are 0.

        Raises:
            MessageError: a value does not fit into its signal.
        """
        message = self.vehicle.messages[message_name]
        signals = self._signals[message_name]
        full = {name: float(signal.offset) for name, signal in signals.items()} | dict(values)
        protection = self.vehicle.protections.get(message_name, UNPROTECTED)
        count = 0
        if protection.counter:
            count = (self._sent.get(message_name, -1) + 1) % protection.modulo
            self._sent[message_name] = count
            full[protection.counter] = count
        try:
            data = bytes(message.encode(full, strict=True))
        except Exception as error:
            raise MessageError(f"{message_name} cannot carry {dict(values)}: {error}") from error
        if protection.checksum is not None:
            data = protection.checksum.put(message.frame_id, data, count)
        return message.frame_id, data

    def encode_command(
        self, target: CommandTarget, value: float, *, enabled: bool, standing: bool = False
    ) -> tuple[int, bytes]:
        """Return the frame of a command in SI units; a value beyond the signal's range is cut to it.

        Args:
            standing: whether the car stands, where `hold` and `resume` count.
        """
        signals = self._signals[target.message]
        values = dict(target.fixed)
        for name, place in target.copied.items():
            if place in self._copied:
                values[name] = self._copied[place]
        request = target.from_si(value)
        values |= dict.fromkeys((target.signal, *target.same), request)
        values |= dict.fromkeys(target.positive, max(request, target.from_si(0.0)))
        values |= target.active if enabled else target.inactive
        for name, wanted in ((target.hold, value <= 0.0), (target.resume, value > 0.0)):
            if name:
                values[name] = float(enabled and standing and wanted)
        cut = {name: _nearest(signals[name], number) for name, number in values.items()}
        return self.encode(target.message, cut)

    def _checked(self, message: Any, data: bytes) -> tuple[Mapping[str, Any], FrameFault | None]:
        """Return raw values by signal, and the fault of length, checksum or counter."""
        if len(data) < message.length:
            return {}, FrameFault.LENGTH
        raw = message.decode(data, decode_choices=False)
        protection = self.vehicle.protections.get(message.name, UNPROTECTED)
        count = int(raw[protection.counter]) if protection.counter else 0
        checksum = protection.checksum
        if protection.counter and count >= protection.modulo:
            return raw, FrameFault.CHECKSUM
        if checksum is not None and checksum.stated(data) != checksum.value(
            message.frame_id, data[: message.length], count
        ):
            return raw, FrameFault.CHECKSUM
        if protection.counter:
            watch = self._received.setdefault(message.name, CounterWatch())
            return raw, watch.fault(count, protection.modulo)
        return raw, None


def _nearest(signal: Any, value: float) -> float:
    """Return a value within the range that the DBC states for a signal."""
    if signal.minimum is None or signal.maximum is None or signal.minimum >= signal.maximum:
        return value
    return float(min(max(value, signal.minimum), signal.maximum))


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


MISTRUSTED_S = 60.0
"""Signals that contradicted each other are not trusted for this long: a wrong one fits now and then."""


BURST_S = 2e-3
"""Measurements that arrive closer together have waited for a process that was stopped; none is compared."""


class Plausibility:
    """Compares signals of a car that belong together."""

    def __init__(self) -> None:
        self._watch = SignalWatch()
        self._found: tuple[Contradiction, float] | None = None
        self._arrived_s: dict[str, float] = {}

    def take(self, signals: SignalTable, arrived: Collection[str], time_s: float) -> None:
        """Compare the signals of a pair when one of them has arrived."""
        watch = self._watch
        for name, rate, see in (
            ("gap_m", "relative_speed_m_s", watch.see_gap),
            ("speed_m_s", "acceleration_m_s2", watch.see_speed),
        ):
            if name in arrived:
                is_seen = name == "speed_m_s" or signals.is_set("target_valid", time_s)
                in_time = time_s - self._arrived_s.get(name, -math.inf) >= BURST_S
                value = signals.value(name, time_s) if is_seen and in_time else math.nan
                see(time_s, value, signals.value(rate, time_s))
                self._arrived_s[name] = time_s
        for contradiction in watch.contradictions:
            self._found = contradiction, time_s

    def contradiction(self, now_s: float) -> Contradiction | None:
        """Return which signals are not to be trusted; None for sound ones."""
        if self._found is None or now_s - self._found[1] > MISTRUSTED_S:
            return None
        return self._found[0]


MISSING_CHANGE_M = 0.3
"""Change of the gap by the measured relative speed that is missing when a sensor counts as frozen."""
LEAST_REPEATS = 3
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
