"""A sender and the bridge of received messages in one process: real bits, no sockets."""

from __future__ import annotations

from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.sending.sender import CamSender


class SimulatedRadio:
    """Hands the bridge, before each tick, everything that arrives up to it.

    All of it is received at the time of the tick, as in lock-step over a socket: both give the same numbers.
    """

    def __init__(self, sender: CamSender, bridge: CamBridge) -> None:
        self._sender, self.bridge = sender, bridge
        self._heard_until_ns: int | None = None

    def answer(
        self, time_ns: int, host_position_m: float, host_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick; see `CamBridge.answer`."""
        after_ns = self._heard_until_ns
        if after_ns is None or after_ns > time_ns:
            after_ns = -(10**12)
        for _, datagram in self._sender.arrivals(after_ns, time_ns):
            self.bridge.receive(datagram, time_ns)
        self._heard_until_ns = time_ns
        return self.bridge.answer(time_ns, host_position_m, host_speed_m_s)
