"""Attacks on the V2X receiver while it drives: what it makes of them, and what the car does.

Each attack is sent for eight seconds to a car that follows a leader at 12 m/s, in closed loop without ROS.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import formatted_table, run_benchmark
from iptm_controller.controller import Controller
from iptm_controller.horizon import MULTI_HORIZON
from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import STRATEGIES
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.parameters import load_parameters
from iptm_core.routes import Route, build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.state import NS_PER_S, FloatArray
from iptm_plant_sim.plant import Plant
from iptm_studies.closed_loop import ClosedLoopRun, run_closed_loop
from iptm_v2x_bridge.bridge import BridgeAnswer
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.cam import encode_cam
from iptm_v2x_bridge.radio_recording import SimulatedRadio
from iptm_v2x_bridge.sending.sender import CamSender, build_sender, car_on_road
from iptm_v2x_bridge.sending.settings import Foresight, Framing, SenderSettings

ROAD = RoadLine.test_road()
PARAMETERS = load_parameters().values
BEGIN_S, END_S, TRIP_S = 25, 33, 45
SENDER = SenderSettings(framing=Framing.BARE, path_points=10)
LEADER = SENDER.station_id
FORGER = 666
SPEED_M_S = 12.0
FLOOD = 10_000

Attack = Callable[[int, float], list[bytes]]
"""What is sent in a second of trip time, the host being where it is."""


@dataclass(frozen=True)
class Outcome:
    """A drive under attack and what the receiver made of it."""

    loop: ClosedLoopRun
    bridge: CamBridge
    leaders: list[int | None]
    contested: list[bool]
    refused: dict[str, int]

    def margins_m(self) -> FloatArray:
        """Return the true gap less s_min at every tick."""
        return gap_margins_m(self.loop.trajectory, PARAMETERS)


class AttackedRadio(SimulatedRadio):
    """The genuine messages of each second, then those of the attacker."""

    def __init__(
        self, route: Route, attack: Attack | None, settings: SenderSettings = SENDER
    ) -> None:
        super().__init__(build_sender(route.leader, ROAD, settings), CamBridge(ROAD))
        self._attack = attack
        self.leaders: list[int | None] = []
        self.contested: list[bool] = []

    def answer(
        self, time_ns: int, host_position_m: float, host_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick."""
        second = time_ns // NS_PER_S
        answer = super().answer(time_ns, host_position_m, host_speed_m_s)
        if self._attack is not None and BEGIN_S <= second < END_S:
            for datagram in self._attack(second, host_position_m):
                self.bridge.receive(datagram, time_ns)
            answer = self.bridge.answer(time_ns, host_position_m, host_speed_m_s)
        self.leaders.append(self.bridge.leader_id)
        self.contested.append(answer.contested)
        return answer


class SilencedRadio(SimulatedRadio):
    """Nothing is heard any more from a second of trip time on: jammed, or out of reach."""

    def __init__(self, sender: CamSender) -> None:
        super().__init__(sender, CamBridge(ROAD))
        self.leaders: list[int | None] = []
        self.contested: list[bool] = []

    def answer(
        self, time_ns: int, host_position_m: float, host_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick."""
        silent = time_ns >= BEGIN_S * NS_PER_S
        answer = (self.bridge if silent else super()).answer(
            time_ns, host_position_m, host_speed_m_s
        )
        self.leaders.append(self.bridge.leader_id)
        self.contested.append(answer.contested)
        return answer


def tenths(second: int) -> range:
    """Return the instants of the second up to a tick, ms."""
    return range(1000 * second - 900, 1000 * second + 1, 100)


def forged(
    station_id: int, at_ms: int, rear_m: float, speed_m_s: float, left_m: float = 0.0
) -> bytes:
    """Return the message of a forged car."""
    return encode_cam(car_on_road(ROAD, station_id, at_ms, rear_m, speed_m_s, left_m=left_m))


def forged_car(_: Route) -> Attack:
    """A car appears 5 m in front of the host and drives on at its speed."""
    start: list[float] = []

    def attack(second: int, host_m: float) -> list[bytes]:
        start.append(host_m)
        origin = start[0] + 5.0 - SPEED_M_S * BEGIN_S
        places = ((at_ms, origin + SPEED_M_S * at_ms / 1000.0) for at_ms in tenths(second))
        return [forged(FORGER, at_ms, rear_m, SPEED_M_S) for at_ms, rear_m in places]

    return attack


def replayed(route: Route) -> Attack:
    """The leader's messages again, at once and seconds later."""
    recorded = CamSender(route.leader, ROAD, SENDER)
    return lambda second, _: [
        recorded.datagram_at((at_ms - late_ms) * 1_000_000)
        for late_ms in (0, 1500, 8000)
        for at_ms in tenths(second)
    ]


def replayed_a_wrap_later(route: Route) -> Attack:
    """The leader's messages of before, with a time of generation that looks new."""
    recorded = CamSender(route.leader, ROAD, SENDER)

    def attack(second: int, _: float) -> list[bytes]:
        old = recorded.message_at((second - 15) * NS_PER_S)
        return [encode_cam(replace(old, delta_time_ms=(1000 * second + 50) % 65_536))]

    return attack


def jumping(_: Route) -> Attack:
    """A car ahead is in the next lane in every second message."""
    return lambda second, host_m: [
        forged(FORGER, at_ms, host_m + 8.0, SPEED_M_S, 3.5 if at_ms % 200 else 0.0)
        for at_ms in tenths(second)
    ]


def absurdly_fast(_: Route) -> Attack:
    """A car ahead drives 120 m/s."""
    return lambda second, host_m: [
        forged(FORGER, at_ms, host_m + 8.0, 120.0) for at_ms in tenths(second)
    ]


def flood(_: Route) -> Attack:
    """Ten thousand identities ahead at once."""
    return lambda second, host_m: [
        forged(10_000 + number, 1000 * second, host_m + 6.0, SPEED_M_S)
        for number in range(FLOOD if second == BEGIN_S else 0)
    ]


def same_identity(_: Route) -> Attack:
    """A second sender with the leader's identity stands 5 m ahead."""
    return lambda second, host_m: [
        forged(LEADER, at_ms + 50, host_m + 5.0, 0.0) for at_ms in tenths(second)
    ]


def clock_set_back(route: Route) -> Attack:
    """The leader's messages with times of the past."""
    recorded = CamSender(route.leader, ROAD, SENDER)

    def attack(second: int, _: float) -> list[bytes]:
        now = recorded.message_at(second * NS_PER_S)
        return [
            encode_cam(replace(now, delta_time_ms=(1000 * second - back_ms) % 65_536))
            for back_ms in (100, 2500, 30_000)
        ]

    return attack


ATTACKS: Mapping[str, Callable[[Route], Attack]] = {
    "a forged car 5 m ahead that moves like one": forged_car,
    "messages replayed seconds later": replayed,
    "messages replayed a whole wrap (65.536 s) later": replayed_a_wrap_later,
    "a station that jumps between lanes": jumping,
    "absurd speed": absurdly_fast,
    "10,000 stations at once": flood,
    "a second sender with the leader's identity that stands 5 m ahead": same_identity,
    "time set back": clock_set_back,
}
SILENCE = "silence: jammed while the leader brakes unheard"


def written_route(text: str, duration_s: float) -> Route:
    """Return a route from the text of a CSV file."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "leader.csv"
        file.write_text(f"time_s,speed_m_s\n{text}")
        gap_m = PARAMETERS.gap.initial_gap_m
        return build_route(str(file), initial_gap_m=gap_m, duration_s=duration_s)


def steady_route() -> Route:
    """Return a leader that pulls away and drives 12 m/s."""
    return written_route(f"0,0\n12,{SPEED_M_S}\n60,{SPEED_M_S}\n", TRIP_S)


def controller() -> Controller:
    """Return a fresh controller."""
    return Controller(PARAMETERS, ControllerOptions(STRATEGIES["aging"], MULTI_HORIZON))


def drive(route: Route, radio: AttackedRadio | SilencedRadio) -> Outcome:
    """Drive a route in closed loop."""
    plant = Plant(PARAMETERS, route.slope.slope_at)
    loop = run_closed_loop(route, plant, controller(), bridge=radio)
    refused = radio.bridge.table.rejections.by_reason()
    return Outcome(loop, radio.bridge, radio.leaders, radio.contested, refused)


def silenced() -> tuple[Outcome, Outcome]:
    """Drive behind a leader that brakes to a halt, heard and unheard."""
    route = written_route("0,0\n12,14\n26,14\n32,0\n75,0\n", 75.0)
    plain = replace(SENDER, foresight=Foresight.NONE)
    sender = CamSender(route.leader, ROAD, plain)
    heard = AttackedRadio(route, None)
    return drive(route, heard), drive(route, SilencedRadio(sender))


def outcomes() -> Iterator[tuple[str, Outcome, Outcome]]:
    """Yield each attack with the drive without and with it."""
    route = steady_route()
    undisturbed = drive(route, AttackedRadio(route, None))
    for title, attack in ATTACKS.items():
        yield title, undisturbed, drive(route, AttackedRadio(route, attack(route)))
    yield SILENCE, *silenced()


def measure() -> dict[str, Any]:
    """Drive under every attack."""
    rows = []
    for title, undisturbed, outcome in outcomes():
        run, usual = outcome.loop.trajectory, undisturbed.loop.trajectory
        after = slice(BEGIN_S, None)
        refused = ", ".join(f"`{name}` {count}" for name, count in outcome.refused.items())
        rows.append(
            {
                "attack": title,
                "refused": refused or "nothing",
                "contested_s": sum(outcome.contested),
                "misled_s": sum(leader != LEADER for leader in outcome.leaders[after]),
                "moved_m": float(np.abs(run.position_m - usual.position_m).max()),
                "hardest_braking_m_s2": float(-run.acceleration_m_s2[after].min()),
                "usual_braking_m_s2": float(-usual.acceleration_m_s2[after].min()),
                "smallest_gap_m": float(run.gap_m[after].min()),
                "smallest_margin_m": float(outcome.margins_m()[after].min()),
            }
        )
    return {"rows": rows}


COLUMNS = {
    "attack": "{attack}",
    "messages refused": "{refused}",
    "identity contested:": "{contested_s} s",
    "follows another one:": "{misled_s} s",
    "car moved by at most:": "{moved_m:.1f} m",
    "hardest braking:": "{hardest_braking_m_s2:.2f} m/s²",
    "without the attack:": "{usual_braking_m_s2:.2f} m/s²",
    "smallest true gap:": "{smallest_gap_m:.1f} m",
    "less s_min:": "{smallest_margin_m:.1f} m",
}


def as_table(numbers: dict[str, Any]) -> str:
    """Return the numbers as a table in Markdown."""
    return formatted_table(numbers["rows"], COLUMNS)


if __name__ == "__main__":
    sys.exit(run_benchmark(measure, text_of=as_table))
