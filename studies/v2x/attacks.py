"""Attacks on the V2X receiver while it drives: what it makes of them, and what the car does.

Each attack is sent for eight seconds to a car that follows a leader at 12 m/s, in closed loop without ROS.
An impostor, a second sender with the identity of the leader, repeats its motion at 15 m/s until it brakes to
a halt with 2.5 m/s2 from 60 s on; then it drives on, or moves out of the lane. The radio is the only source
of the leader; the vehicle without radio has an exact range sensor.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from studies.v2x.impostor import CLOCKS, DEPARTURE_S, ContestedSender, Impostor

from iptm.closed_loop import ClosedLoopRun, run_closed_loop
from iptm_controller.controller import MpcController
from iptm_controller.horizon import MULTI_HORIZON
from iptm_controller.options import ControllerOptions
from iptm_controller.strategy import STRATEGIES
from iptm_core.braking import RadioSettings, SafetyMonitorSettings
from iptm_core.markdown import table_of
from iptm_core.metrics.constraints import gap_margins_m
from iptm_core.parameters import load_parameters
from iptm_core.routes import Route, build_route
from iptm_core.routes.road_line import RoadLine
from iptm_core.settings import PreviewMode, PreviewSettings
from iptm_core.state import NS_PER_S, FloatArray
from iptm_core.trajectory import Trajectory
from iptm_plant_sim.plant import Plant
from iptm_v2x_bridge.bridge import BridgeAnswer, TickBridge
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.cam import encode_cam
from iptm_v2x_bridge.radio_recording import SimulatedRadio
from iptm_v2x_bridge.sender import CamSender, car_on_road
from iptm_v2x_bridge.settings import Foresight, Framing, SenderSettings

ROAD, PARAMETERS = RoadLine.test_road(), load_parameters().values
BEGIN_S, END_S, TRIP_S = 25, 33, 45
BRAKING_TRIP_S = 95
SENDER = SenderSettings(framing=Framing.BARE, path_points=10)
LEADER, FORGER = SENDER.station_id, 666
SPEED_M_S = 12.0
FLOOD = 10_000


class Moment(NamedTuple):
    """A second of an attack: the leader as it would send, the ego vehicle then and at the beginning."""

    leader: CamSender
    second: int
    ego_m: float
    begin_m: float


Attack = Callable[[Moment], list[bytes]]
"""What is sent in a second."""


class AttackedRadio(SimulatedRadio):
    """The genuine messages of each second, then the attacker's; nothing from a silence on.

    Attributes:
        loop: the drive, once it has ended.
        leaders: who led, tick by tick.
        contested: whether the identity of the leader was contested, tick by tick.
    """

    loop: ClosedLoopRun

    def __init__(
        self,
        route: Route,
        attack: Attack | None,
        settings: SenderSettings = SENDER,
        silent_from_s: float = float("inf"),
        impostor: Impostor | None = None,
    ) -> None:
        super().__init__(ContestedSender(route.leader, ROAD, settings, impostor), CamBridge(ROAD))
        self._attack = attack
        self._leader = CamSender(route.leader, ROAD, SENDER)
        self._begin_m = 0.0
        self._silent_from_s = silent_from_s
        self.leaders: list[int | None] = []
        self.contested: list[bool] = []

    def answer(
        self, time_ns: int, ego_position_m: float, ego_speed_m_s: float = 0.0
    ) -> BridgeAnswer:
        """Return the answer to one tick."""
        second = time_ns // NS_PER_S
        asked = time_ns, ego_position_m, ego_speed_m_s
        is_silent = second >= self._silent_from_s
        answer = self.bridge.answer(*asked) if is_silent else super().answer(*asked)
        if self._attack is not None and BEGIN_S <= second < END_S:
            if second == BEGIN_S:
                self._begin_m = ego_position_m
            moment = Moment(self._leader, second, ego_position_m, self._begin_m)
            for datagram in self._attack(moment):
                self.bridge.receive(datagram, time_ns)
            answer = self.bridge.answer(*asked)
        self.leaders.append(self.bridge.leader_id)
        self.contested.append(answer.contested)
        return answer

    @property
    def refused(self) -> dict[str, int]:
        """Counts of refused messages by reason."""
        return self.bridge.table.rejections.by_reason()

    def margins_m(self) -> FloatArray:
        """Return the true gap less s_min at every tick."""
        return gap_margins_m(self.loop.trajectory, PARAMETERS)


def tenths(second: int) -> range:
    """Return the instants of the second up to a tick, ms."""
    return range(1000 * second - 900, 1000 * second + 1, 100)


def forged(
    station_id: int, at_ms: int, rear_m: float, speed_m_s: float, left_m: float = 0.0
) -> bytes:
    """Return the message of a forged car."""
    return encode_cam(car_on_road(ROAD, station_id, at_ms, rear_m, speed_m_s, left_m=left_m))


def forged_car(now: Moment) -> list[bytes]:
    """A car appears 5 m in front of the ego vehicle and drives on at its speed."""
    origin_m = now.begin_m + 5.0 - SPEED_M_S * BEGIN_S
    return [
        forged(FORGER, at_ms, origin_m + SPEED_M_S * at_ms / 1000.0, SPEED_M_S)
        for at_ms in tenths(now.second)
    ]


def replayed(now: Moment) -> list[bytes]:
    """The leader's messages again, at once and seconds later."""
    return [
        now.leader.datagram_at((at_ms - late_ms) * 1_000_000)
        for late_ms in (0, 1500, 8000)
        for at_ms in tenths(now.second)
    ]


def replayed_a_wrap_later(now: Moment) -> list[bytes]:
    """The leader's messages of before, with a time of generation that looks new."""
    old = now.leader.message_at((now.second - 15) * NS_PER_S)
    return [encode_cam(replace(old, delta_time_ms=(1000 * now.second + 50) % 65_536))]


def jumping(now: Moment) -> list[bytes]:
    """A car ahead is in the next lane in every second message."""
    return [
        forged(FORGER, at_ms, now.ego_m + 8.0, SPEED_M_S, 3.5 if at_ms % 200 else 0.0)
        for at_ms in tenths(now.second)
    ]


def absurdly_fast(now: Moment) -> list[bytes]:
    """A car ahead drives 120 m/s."""
    return [forged(FORGER, at_ms, now.ego_m + 8.0, 120.0) for at_ms in tenths(now.second)]


def flood(now: Moment) -> list[bytes]:
    """Ten thousand identities ahead at once."""
    return [
        forged(10_000 + number, 1000 * now.second, now.ego_m + 6.0, SPEED_M_S)
        for number in range(FLOOD if now.second == BEGIN_S else 0)
    ]


def same_identity(now: Moment) -> list[bytes]:
    """A second sender with the leader's identity stands 5 m ahead."""
    return [forged(LEADER, at_ms + 50, now.ego_m + 5.0, 0.0) for at_ms in tenths(now.second)]


def clock_set_back(now: Moment) -> list[bytes]:
    """The leader's messages with times of the past."""
    message = now.leader.message_at(now.second * NS_PER_S)
    return [
        encode_cam(replace(message, delta_time_ms=(1000 * now.second - back_ms) % 65_536))
        for back_ms in (100, 2500, 30_000)
    ]


ATTACKS: Mapping[str, Attack] = {
    "a forged car 5 m ahead that moves like one": forged_car,
    "messages replayed seconds later": replayed,
    "messages replayed a whole wrap (65.536 s) later": replayed_a_wrap_later,
    "a station that jumps between lanes": jumping,
    "absurd speed": absurdly_fast,
    "10,000 stations at once": flood,
    "a second sender with the leader's identity that stands 5 m ahead": same_identity,
    "time set back": clock_set_back,
}


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


def braking_route() -> Route:
    """Return the leader that brakes behind an impostor's back."""
    text = f"0,0\n15,15\n{DEPARTURE_S},15\n{DEPARTURE_S + 6},0\n120,0\n"
    return written_route(text, BRAKING_TRIP_S)


def looped(
    route: Route, bridge: TickBridge | None = None, settings: PreviewSettings | None = None
) -> ClosedLoopRun:
    """Drive a route in closed loop with a fresh controller; no message is signed."""
    radio = RadioSettings(authenticated_radio=False)
    options = ControllerOptions(STRATEGIES["aging"], MULTI_HORIZON, radio=radio)
    controller = MpcController(PARAMETERS, options)
    safety = SafetyMonitorSettings(authenticated_radio=False)
    plant = Plant(PARAMETERS, route.slope.slope_at, safety=safety)
    return run_closed_loop(route, plant, controller, settings, bridge=bridge)


def drive(route: Route, radio: AttackedRadio) -> AttackedRadio:
    """Drive a route by radio, and return it."""
    radio.loop = looped(route, radio)
    return radio


def without_radio(route: Route) -> Trajectory:
    """Return the drive with an exact range sensor and no previews."""
    return looped(route, settings=PreviewSettings(preview_mode=PreviewMode.NONE)).trajectory


def impersonated(
    route: Route, foresight: Foresight, impostor: Impostor | None, delay_s: float = 0.0
) -> AttackedRadio:
    """Drive behind a leader whose identity another sender uses."""
    settings = replace(SENDER, foresight=foresight, link_delay_s=delay_s)
    return drive(route, AttackedRadio(route, None, settings, impostor=impostor))


def silenced() -> tuple[AttackedRadio, AttackedRadio]:
    """Drive behind a leader that brakes to a halt, heard and unheard."""
    route = written_route("0,0\n12,14\n26,14\n32,0\n75,0\n", 75.0)
    plain = replace(SENDER, foresight=Foresight.NONE)
    return (
        drive(route, AttackedRadio(route, None)),
        drive(route, AttackedRadio(route, None, plain, BEGIN_S)),
    )


def attack_row(title: str, undisturbed: AttackedRadio, outcome: AttackedRadio) -> dict[str, Any]:
    """Return one row of the table of attacks."""
    run, usual = outcome.loop.trajectory, undisturbed.loop.trajectory
    after = slice(BEGIN_S, None)
    refused = [f"`{name}` {count}" for name, count in outcome.refused.items()] or ["nothing"]
    return {
        "attack": title,
        "refused": ", ".join(refused),
        "contested_s": sum(outcome.contested),
        "misled_s": sum(leader != LEADER for leader in outcome.leaders[after]),
        "moved_m": float(np.abs(run.position_m - usual.position_m).max()),
        "hardest_braking_m_s2": float(-run.acceleration_m_s2[after].min()),
        "usual_braking_m_s2": float(-usual.acceleration_m_s2[after].min()),
        "smallest_gap_m": float(run.gap_m[after].min()),
        "smallest_margin_m": float(outcome.margins_m()[after].min()),
    }


def impostor_row(trajectory: Trajectory, contested: list[bool], *names: str) -> dict[str, Any]:
    """Return one row of the table of impostors."""
    reported = f"{max(contested.index(True) - DEPARTURE_S, 0)} s" if any(contested) else "-"
    return {
        **dict(zip(("impostor", "stamps", "paths"), names, strict=True)),
        "reported": reported,
        "hardest_braking_m_s2": float(-trajectory.acceleration_m_s2[DEPARTURE_S:].min()),
        "smallest_gap_m": float(trajectory.gap_m.min()),
    }


def measure() -> dict[str, Any]:
    """Drive under every attack, and with every impostor."""
    route = steady_route()
    undisturbed = drive(route, AttackedRadio(route, None))
    attacks = [
        attack_row(title, undisturbed, drive(route, AttackedRadio(route, attack)))
        for title, attack in ATTACKS.items()
    ]
    attacks.append(attack_row("silence: jammed while the leader brakes unheard", *silenced()))
    route = braking_route()
    rows = [impostor_row(without_radio(route), [], "no radio", "-", "-")]
    departures: list[tuple[str, str, Impostor | None, float]] = [("-", "-", None, 0.0)]
    for drifts, (stamps, (impostor, delay_s)) in product((False, True), CLOCKS.items()):
        name = "drifts aside" if drifts else "keeps speed"
        departures.append((name, stamps, replace(impostor, drifts_aside=drifts), delay_s))
    for foresight, (name, stamps, who, delay_s) in product(Foresight, departures):
        outcome = impersonated(route, foresight, who, delay_s)
        paths = "yes" if foresight is Foresight.PATH else "no"
        rows.append(impostor_row(outcome.loop.trajectory, outcome.contested, name, stamps, paths))
    return {"attacks": attacks, "impostors": rows}


COLUMNS = {
    "attacks": {
        "attack": "{attack}",
        "messages refused": "{refused}",
        "identity contested:": "{contested_s} s",
        "follows another one:": "{misled_s} s",
        "car moved by at most:": "{moved_m:.1f} m",
        "hardest braking:": "{hardest_braking_m_s2:.2f} m/s²",
        "without the attack:": "{usual_braking_m_s2:.2f} m/s²",
        "smallest true gap:": "{smallest_gap_m:.1f} m",
        "less s_min:": "{smallest_margin_m:.1f} m",
    },
    "impostors": {
        "impostor": "{impostor}",
        "stamps": "{stamps}",
        "paths sent": "{paths}",
        "reported after:": "{reported}",
        "hardest braking:": "{hardest_braking_m_s2:.2f} m/s²",
        "smallest true gap:": "{smallest_gap_m:.2f} m",
    },
}


def as_tables(numbers: dict[str, Any]) -> dict[str, str]:
    """Return both tables in Markdown."""
    return {name: table_of(numbers[name], columns) for name, columns in COLUMNS.items()}
