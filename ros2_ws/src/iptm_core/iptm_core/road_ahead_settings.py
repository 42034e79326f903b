"""Settings of what bounds the ego vehicle's motion: source of the lead vehicle, rules of the road."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_core.declaration import Settings, parameter
from iptm_core.errors import ParameterError
from iptm_core.settings import LeaderSource


@dataclass(frozen=True)
class RoadAheadSettings(Settings):
    """Source of the lead vehicle, and the rules of the road for the host.

    Raises:
        ParameterError: a value is out of range, or rules are to be kept and no speed is limited.
    """

    leader_source: LeaderSource = parameter(
        LeaderSource.CYCLE,
        "cycle: the leader drives the cycle; cam: it is observed by the messages that arrive; vehicle: it is "
        "vehicle_ahead, whose plans are the previews; none: the road is empty; with the latter three the "
        "cycle gives the road only",
    )
    host_keeps_rules: bool = parameter(
        default=False,
        description="with a leader: the host keeps speed limits and signals where they are stricter, and "
        "drives on where none is observed; without one it always does",
    )
    set_speed_km_h: float = parameter(
        0.0,
        "set speed of the driver where rules are kept, 0 for none",
        "km/h",
        0.0,
        250.0,
    )
    speed_limits_km_h: str = parameter(
        "",
        "speed limits of the road, <from metre>:<km/h> parts, e.g. '0:50, 1200:70'; cycle: between two halts "
        "the lowest usual limit that the cycle keeps",
    )
    signals: str = parameter(
        "",
        "signals of the road with plans that repeat themselves, <metre of the stop line>:<cycle in s>:"
        "<s of trip time, with cam of TimestampIts, at which it turns green>:<s for which it is green> parts",
    )
    line_foresight_s: float = parameter(
        60.0, "stop lines that the host reaches later are not looked at", "s", 1.0, 3600.0
    )
    max_lateral_acceleration_m_s2: float = parameter(
        2.0, "where rules are kept, curves are passed with this at most", "m/s^2", 0.1, 10.0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.keeps_rules and not (self.speed_limits_km_h.strip() or self.set_speed_km_h):
            why = "leader_source none" if not self.host_keeps_rules else "host_keeps_rules"
            raise ParameterError(
                f"speed_limits_km_h is empty and set_speed_km_h is 0 with {why}; allowed: one of them stated"
            )

    @property
    def keeps_rules(self) -> bool:
        """Whether the rules of the road bind the host."""
        return self.host_keeps_rules or self.leader_source is LeaderSource.NONE
