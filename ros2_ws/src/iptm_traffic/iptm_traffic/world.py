"""The traffic as the world around the host: SUMO goes on while the host moves, and shows who is ahead."""

from __future__ import annotations

from iptm_core.state import FloatArray, LeaderPreview, LeaderState, VehicleState
from iptm_traffic.demand import TrafficScenario
from iptm_traffic.events import Director, LeaderWatch, LineWatch
from iptm_traffic.right_of_way import RightOfWay
from iptm_traffic.simulation import HostInstant, TrafficSimulation
from iptm_v2x_bridge.source import single_sample


class SumoWorld:
    """Moves the host in SUMO and looks at the traffic around it; a `World` of the closed loop.

    Attributes:
        ahead: the cars ahead, one after the other.
        lines: stop lines that the host has passed.
        found: name, gap and speed of the car ahead at the present tick, None if there is none.
    """

    def __init__(
        self,
        scenario: TrafficScenario,
        simulation: TrafficSimulation,
        right_of_way: RightOfWay | None = None,
    ) -> None:
        """Look at the traffic at trip time 0.

        Args:
            scenario: what is to happen.
            simulation: at trip time 0, with the host in it.
            right_of_way: refreshed at every tick; None where all rules are those of the network.
        """
        self._simulation, self._time_s = simulation, 0.0
        self._director = Director(scenario, simulation)
        self.ahead, self._right_of_way = LeaderWatch(simulation), right_of_way
        self.lines = LineWatch(right_of_way.shown if right_of_way else simulation.network.rules)
        self._look()

    def pass_interval(
        self, before: VehicleState | HostInstant, after: VehicleState | HostInstant
    ) -> None:
        """Let an interval pass in which the host moves from one state to the other."""
        self.lines.watch(before, after)
        self._simulation.move_host(after, after.time_s - before.time_s)
        self._time_s = after.time_s
        if self._right_of_way is not None:
            self._right_of_way.refresh()
        self._look()

    def _look(self) -> None:
        self.found = self.ahead.watch()
        self._director.direct(None if self.found is None else self.found[0])

    def leader_at(self, time_ns: int) -> LeaderState | None:
        """Return the car ahead at the present tick, None if there is none."""
        del time_ns
        if self.found is None:
            return None
        _, gap_m, speed_m_s = self.found
        return LeaderState(self._time_s, self._simulation.host_position_m + gap_m, speed_m_s)

    def sampled(self, times_s: FloatArray) -> LeaderPreview:
        """Return the car ahead at the present tick; where it will be, SUMO has not decided yet."""
        del times_s
        return single_sample(self.leader_at(0))
