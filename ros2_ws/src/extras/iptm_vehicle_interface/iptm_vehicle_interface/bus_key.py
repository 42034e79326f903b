"""A bus whose frames prove their sender, for a link between suite and gateway that leaves the machine.

In the manner of AUTOSAR's secure onboard communication (SecOC): each frame carries a freshness value and a
truncated message authentication code (HMAC-SHA-256, RFC 2104) of sender, identifier, freshness and data under
a key that both ends hold. The freshness is the sender's time in nanoseconds and increases strictly; a frame
that is repeated, or older than `WINDOW_S` by the receiver's clock, does not count. Both clocks have to agree
as well. Frames of a keyed bus are frames of CAN FD with up to `LONGEST` bytes of data.
"""

from __future__ import annotations

import hashlib
import hmac
import stat
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from iptm_core.errors import MessageError, ScenarioError
from iptm_drives.can_files import library
from iptm_vehicle_interface.bus import open_buses

GATEWAY, SUITE = b"gateway", b"suite"
WINDOW_S = 0.2
LEAST_KEY_BYTES = 16
_FRESHNESS_BYTES, _CODE_BYTES = 8, 12
_HEAD = 1 + _FRESHNESS_BYTES + _CODE_BYTES
_FD_LENGTHS = (24, 32, 48, 64)
LONGEST = _FD_LENGTHS[-1] - _HEAD


def read_key(path: Path) -> bytes:
    """Return the key in a file: hexadecimal digits, readable by its owner alone.

    Raises:
        ScenarioError: the file cannot be read, is open to others, or holds no key.
    """
    try:
        if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise ScenarioError(f"{path} is open to others; allowed: chmod 600")
        key = bytes.fromhex(path.read_text("ascii"))
    except OSError as error:
        raise ScenarioError(f"{path}: {error.strerror}; allowed: a file with a key") from error
    except ValueError:
        key = b""
    if len(key) < LEAST_KEY_BYTES:
        raise ScenarioError(
            f"{path} holds no key; allowed: {2 * LEAST_KEY_BYTES} hexadecimal digits or more"
        )
    return key


class KeyedBus:
    """A bus around another one; see the module."""

    def __init__(
        self, bus: Any, key: bytes, sender: bytes, clock_ns: Callable[[], int] = time.time_ns
    ) -> None:
        self._bus, self._key, self._sender = bus, key, sender
        self._peer = SUITE if sender == GATEWAY else GATEWAY
        self._clock_ns, self._sent_ns, self._heard_ns = clock_ns, 0, 0

    def send(self, message: Any) -> None:
        """Send a frame with its proof."""
        data = bytes(message.data)
        if len(data) > LONGEST:
            raise library("can").CanOperationError(f"{len(data)} bytes; allowed: {LONGEST}")
        self._sent_ns = max(self._sent_ns + 1, self._clock_ns())
        fresh = self._sent_ns.to_bytes(_FRESHNESS_BYTES, "big")
        code = self._code(self._sender, message.arbitration_id, fresh, data)
        whole = bytes([len(data)]) + fresh + code + data
        length = next(each for each in _FD_LENGTHS if each >= len(whole))
        self._bus.send(self._message(message, whole.ljust(length, b"\0")))

    def recv(self, timeout: float) -> Any:
        """Return the next frame of the other end, None for none in time, or for one's own.

        Raises:
            MessageError: a frame is not proved, repeated or too old.
        """
        message = self._bus.recv(timeout)
        if message is None or message.is_error_frame:
            return message
        whole = bytes(message.data)
        length = whole[0] if whole else 0
        fresh, code = whole[1 : 1 + _FRESHNESS_BYTES], whole[1 + _FRESHNESS_BYTES : _HEAD]
        data = whole[_HEAD : _HEAD + length]
        place = message.arbitration_id, fresh, data
        if hmac.compare_digest(code, self._code(self._sender, *place)):
            return None
        name = f"frame {message.arbitration_id:#x}"
        if len(data) != length or not hmac.compare_digest(code, self._code(self._peer, *place)):
            raise MessageError(f"{name}: wrong authentication code")
        sent_ns = int.from_bytes(fresh, "big")
        if sent_ns <= self._heard_ns or abs(self._clock_ns() - sent_ns) > 1e9 * WINDOW_S:
            raise MessageError(f"{name}: repeated, or too old")
        self._heard_ns = sent_ns
        return self._message(message, data)

    def shutdown(self) -> None:
        """Close the bus."""
        self._bus.shutdown()

    def _code(self, sender: bytes, frame_id: int, fresh: bytes, data: bytes) -> bytes:
        text = sender + frame_id.to_bytes(4, "big") + fresh + data
        return hmac.new(self._key, text, hashlib.sha256).digest()[:_CODE_BYTES]

    @staticmethod
    def _message(like: Any, data: bytes) -> Any:
        return library("can").Message(
            arbitration_id=like.arbitration_id,
            data=data,
            is_extended_id=like.is_extended_id,
            is_fd=len(data) > 8,
            bitrate_switch=len(data) > 8,
        )


def open_keyed(
    addresses: Sequence[str], has_fd: Sequence[bool], key: bytes | None, sender: bytes
) -> list[Any]:
    """Open the buses between suite and gateway; see `open_buses`.

    Args:
        key: None for buses that do not leave the machine.
        sender: which end this one is.
    """
    if key is None:
        return open_buses(addresses, has_fd)
    return [KeyedBus(bus, key, sender) for bus in open_buses(addresses, [True] * len(has_fd))]
