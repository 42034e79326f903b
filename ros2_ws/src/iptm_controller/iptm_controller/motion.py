"""Motion sampled at nodes, with speed linear and position quadratic in between."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iptm_core.state import FloatArray


@dataclass(frozen=True)
class Motion:
    """Positions and speeds at increasing node times; held at constant speed outside them.

    Attributes:
        times_s: node times, shape (n,), increasing, n >= 1.
        positions_m: positions at the nodes, shape (n,).
        speeds_m_s: speeds at the nodes, shape (n,).
    """

    times_s: FloatArray
    positions_m: FloatArray
    speeds_m_s: FloatArray

    def at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions and speeds at any times, shapes of ``times_s``.

        Between two nodes the speed is linear; the position is the cubic that meets both nodes in
        position and speed, which is the exact quadratic where the nodes are consistent.
        """
        nodes = self.times_s
        if nodes.size == 1:
            elapsed = times_s - nodes[0]
            return self.positions_m[0] + self.speeds_m_s[0] * elapsed, np.full(
                times_s.shape, self.speeds_m_s[0]
            )
        index = np.clip(np.searchsorted(nodes, times_s, side="right") - 1, 0, nodes.size - 2)
        start, width = nodes[index], nodes[index + 1] - nodes[index]
        inside = np.clip(times_s, nodes[0], nodes[-1])
        tau = (inside - start) / width
        v_0, v_1 = self.speeds_m_s[index], self.speeds_m_s[index + 1]
        p_0, p_1 = self.positions_m[index], self.positions_m[index + 1]
        # Rest that a linear speed leaves over; zero for consistent nodes.
        rest = p_1 - p_0 - 0.5 * width * (v_0 + v_1)
        position = p_0 + width * tau * (v_0 + 0.5 * tau * (v_1 - v_0))
        position = position + rest * tau * tau * (3.0 - 2.0 * tau)
        speed = v_0 + tau * (v_1 - v_0)
        return position + speed * (times_s - inside), speed
