"""The friction of the road for a node: a setting to begin with, then the published values."""

from __future__ import annotations

import math

from std_msgs.msg import Float64

from iptm_core.errors import MessageError
from iptm_core.road_friction import MOST_FRICTION
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

VALID_S = 60.0
"""Wall time for which a value counts that is not repeated."""


class FrictionInput:
    """Listens to `sensor/road_friction`.

    Args:
        node: that listens.
        default: coefficient of friction while nothing is published; 0: not known.
    """

    def __init__(self, node: SuiteNode, default: float) -> None:
        self._node, self._default = node, default
        self._heard = 0.0
        self._heard_s = -math.inf
        node.listen(Topic.ROAD_FRICTION, self._on_friction)

    @property
    def coefficient(self) -> float:
        """The present value, 0 if unknown."""
        is_valid = self._node.awake.now_s() - self._heard_s <= VALID_S
        return self._heard if is_valid else self._default

    def _on_friction(self, message: Float64) -> None:
        if not 0.0 <= message.data <= MOST_FRICTION:
            raise MessageError(
                f"{Topic.ROAD_FRICTION.value} is {message.data}; allowed: 0 to {MOST_FRICTION:g}"
            )
        self._heard, self._heard_s = message.data, self._node.awake.now_s()
