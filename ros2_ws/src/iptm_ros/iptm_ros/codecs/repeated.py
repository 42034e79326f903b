"""Messages that repeat parts of a state, for tools that take standard messages.

Nodes publish them where somebody listens; a recorder that has the state makes the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from iptm_core.units import CELSIUS_ZERO_K
from iptm_ros.codecs.cdr import FRAME_AT
from iptm_ros.codecs.numbers import LAYOUTS, numbers_of
from iptm_ros.topics import EGO_FRAME, TOPICS, Topic

_STATE = {name: place for place, name in enumerate(TOPICS[Topic.PLANT_STATE].fields)}
_TEMPERATURES = {
    Topic.PLANT_CELL_1_TEMPERATURE: _STATE["cell_1_temperature_k"],
    Topic.PLANT_CELL_N_TEMPERATURE: _STATE["cell_n_temperature_k"],
    Topic.PLANT_COOLANT_INLET_TEMPERATURE: _STATE["coolant_inlet_temperature_k"],
    Topic.PLANT_COOLANT_OUTLET_TEMPERATURE: _STATE["coolant_outlet_temperature_k"],
}
REPEATED: Mapping[Topic, Topic] = MappingProxyType(
    {
        **dict.fromkeys(_TEMPERATURES, Topic.PLANT_STATE),
        Topic.PLANT_ACCELERATION: Topic.PLANT_STATE,
        Topic.PLANT_ODOMETRY: Topic.PLANT_STATE,
    }
)
"""Topics that repeat another one, and which, in the order in which they are published."""


def numbers_of_state(state: Sequence[float]) -> dict[Topic, Sequence[float]]:
    """Return the numbers of the messages that repeat a state."""
    found: dict[Topic, Sequence[float]] = {
        topic: (state[place] - CELSIUS_ZERO_K,) for topic, place in _TEMPERATURES.items()
    }
    found[Topic.PLANT_ACCELERATION] = (state[_STATE["acceleration_m_s2"]],)
    found[Topic.PLANT_ODOMETRY] = (state[_STATE["position_m"]], state[_STATE["speed_m_s"]])
    return found


def repeated_messages(topic: Topic, data: bytes) -> dict[Topic, bytes]:
    """Return the messages that repeat a state; none if its form is not the suite's."""
    numbers = numbers_of(topic, data)
    if numbers is None:
        return {}
    frame = data[FRAME_AT : data.index(b"\0", FRAME_AT)].decode()
    prefix = frame.removesuffix(EGO_FRAME).strip("/")
    found = numbers_of_state(numbers.values)
    return {each: LAYOUTS[each].data(numbers.stamp_ns, found[each], prefix) for each in found}
