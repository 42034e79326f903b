"""The plant node: the simulated vehicle, master of the trip time.

Exit codes besides the common ones: 3, the controller was lost and the trip ended with the controlled
stop. 1 is also a vehicle model that failed.
"""

from __future__ import annotations

import sys
from typing import Any

from iptm_core.errors import ServiceError
from iptm_core.lead_track import LeadStatus
from iptm_core.saved_state import write_state
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_plant_sim.node_trip import EXIT_PACK_EMPTY, TripNode
from iptm_plant_sim.trip import CommandHold, TripPhase
from iptm_ros.command_line import node_main
from iptm_ros.diagnostics import REPORT_PERIOD_S, DiagnosticsReporter, Level
from iptm_ros.services import Service, state_path
from iptm_ros.topics import PLANT, Topic

SOUND_BRAKES = 0.95
"""Brakes that deliver a smaller share of the request are reported."""


class PlantNode(TripNode):
    """Publishes the state of every tick and drives on when it has the command that answers it.

    In lock-step mode trip time advances only with commands; in real-time mode it advances with the
    wall clock, and a command is held until it is too old. In either mode services pause the trip, drive
    single intervals and restart it.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._reporter = DiagnosticsReporter.of_node(self, "vehicle")
        self.serve(Service.PAUSE, self._pause)
        self.serve(Service.RESUME, self._resume)
        self.serve(Service.STEP, self._step)
        self.serve(Service.RESET, self._reset)
        self.serve(Service.SAVE_PLANT, self._save_state)
        self.listen(Topic.DIAGNOSTICS, self._on_diagnostics, raw=True)
        self.every(REPORT_PERIOD_S, self._report)
        self._report()

    # --- services

    def _pause(self) -> str:
        self._refuse_in(TripPhase.FINISHED)
        if self._phase is TripPhase.PAUSED:
            return f"paused already, at {self._at()}"
        if self._phase is TripPhase.WAITING or self._is_real_time:
            # Between two ticks other nodes may have a later time than the present state.
            self._pause_due = True
            return "pauses at the next state"
        self._hold_trip()
        self._report()
        return f"paused at {self._at()}"

    def _resume(self) -> str:
        self._refuse_in(TripPhase.FINISHED)
        self._pause_due = False
        if self._phase is TripPhase.WAITING:
            self._is_start_due = True
            return "begins"
        if self._phase is not TripPhase.PAUSED:
            return "not paused"
        at = self._at()
        self._phase = TripPhase.RUNNING
        if self._is_real_time:
            self._let_time_run()
        else:
            self._controller_lost = False
            self._expect_answer()
            if self._hold.answers(self._trip.stamp_ns):
                self._advance(*self._hold.command_at(self._trip.stamp_ns))
        self._report()
        return f"goes on from {at}"

    def _step(self) -> str:
        if self._phase is TripPhase.WAITING and self._options.start_paused:
            self._is_start_due = self._pause_due = True
            return "leads to the first state"
        if self._phase is not TripPhase.PAUSED:
            raise ServiceError(f"the trip is {self._phase.value}; allowed: a step of a paused one")
        at = self._at()
        if self._is_real_time:
            self._judge_command_age()
            self._advance(*self._hold.command_at(self._trip.stamp_ns))
        elif self._hold.answers(self._trip.stamp_ns):
            self._advance(*self._hold.command_at(self._trip.stamp_ns))
        else:
            self._steps_due += 1
            return f"a step from {at} with the command that is awaited"
        return f"a step from {at}"

    def _reset(self) -> str:
        self._refuse_in(TripPhase.WAITING)
        at = self._at()
        for timer in (self._stop_timer, self._end_timer):
            self._cancel(timer)
        self._pause_due = self._pause_due or self._phase is TripPhase.PAUSED
        self._controller_lost = False
        self._failure = ""
        self.exit_code = 0
        self._trip = self._trip.restarted()
        self._hold = CommandHold(self._options.command_timeout_s)
        self._begin()
        return f"a new trip, after {at} of the one before"

    def _save_state(self) -> str:
        self._refuse_in(TripPhase.WAITING)
        path = state_path(self, self._options.state_folder, self._trip.stamp_ns)
        write_state(path, self._options.saved_state(self._trip))
        return f"saved {self._at()} in {path}"

    def _refuse_in(self, phase: TripPhase) -> None:
        if self._phase is phase:
            raise ServiceError(f"the trip is {phase.value}; allowed: one under way")

    def _at(self) -> str:
        return f"{self._trip.step.state.time_s:g} s"

    # --- diagnostics

    def _on_diagnostics(self, data: bytes) -> None:
        if self._reporter.is_from_double(data):
            self.health.note_contradiction(PLANT)

    def _report(self) -> None:
        level, reason = self._situation()
        self._reporter.report(self._trip.stamp_ns, level, reason, self._values)

    def _values(self) -> dict[str, object]:
        trip = self._trip
        values: dict[str, object] = {
            "phase": self._phase.value,
            "mode": self._options.mode.value,
            "tick": trip.tick,
            "ticks": trip.ticks,
            "standstill": trip.step.standstill,
            "command_age_s": self._hold.age_s(trip.stamp_ns),
            "ignored_commands": self._ignored_commands,
            "rejected_commands": self._rejected_commands,
            "repeated_states": self._repeated_states,
            "controller_losses": self._controller_losses,
            "failure": self._failure or "none",
            "limited_ticks": trip.limited_ticks,
            **{f"limited_{kind.value}": count for kind, count in trip.clamps.items()},
            "last_limit": trip.last_reason,
            "interventions": trip.interventions,
            "service_braking_s": trip.service_braking_s,
            "last_intervention": trip.step.memory.reason or "none",
            "road_friction": self._options.road_friction,
            "brake_share": trip.step.safety.brake_share,
            "state_of_charge": trip.step.state.state_of_charge,
            "intervals_without_range_sensor": self._range_sensor.silent_intervals,
            "listener_left_behind": self._outputs[Topic.CLOCK].is_left_behind,
        }
        if self._schedule is not None:
            values["overruns"] = self._schedule.overruns
            values["worst_lateness_s"] = self._schedule.worst_lateness_s
        return values

    def _situation(self) -> tuple[Level, str]:
        if self._phase is TripPhase.WAITING:
            names = ", ".join(self._awaited)
            return Level.WARN, f"waiting for {names or 'the first answer of a controller'}"
        if self._phase is TripPhase.FINISHED:
            return self._outcome()
        if self._phase is TripPhase.PAUSED:
            return Level.WARN, "paused by request"
        lost = "no commands arrive"
        if self._unfitting_commands:
            lost = "commands arrive, but their stamps answer no state that waits for one"
        if self._phase is TripPhase.STOPPING:
            return Level.ERROR, f"{lost}: controlled stop"
        if self._watchdog.is_silent or self._answers.is_silent:
            return Level.STALE, f"{lost}: waiting"
        warning = self._safety_warning() or self._charge_warning()
        if not warning and self._trip.is_limited:
            warning = "commands exceed what the vehicle can do and are limited"
        if not warning and self._outputs[Topic.CLOCK].is_left_behind:
            warning = "a subscriber of the clock is not keeping up; the trip continues without it"
        return (Level.WARN, warning) if warning else (Level.OK, "running")

    def _safety_warning(self) -> str:
        """Return the report on the safety monitor and the brakes, empty if normal."""
        step = self._trip.step
        if step.memory.braking or step.safety.service_braking_s > 0.0:
            return f"the safety monitor brakes: {step.memory.reason}"
        if step.safety.brake_share < SOUND_BRAKES:
            return f"the brakes deliver {step.safety.brake_share:.0%} of what is requested"
        status = step.memory.lead.status(step.state.time_s)
        if status is LeadStatus.FROZEN:
            return "the range sensor repeats a measurement; the vehicle ahead counts as lost"
        if step.memory.lead.is_doubtful:
            return "gap and speed of the vehicle ahead contradict each other; the nearer one counts"
        if status is LeadStatus.LOST and not self._range_sensor.is_silent:
            return "the range sensor has lost the vehicle ahead, which is assumed to brake"
        if step.memory.road_m_s2:
            return f"the road gives no more than {step.memory.road_m_s2:.1f} m/s^2"
        if self._range_sensor.is_silent:
            return "the safety monitor lacks measurements of its range sensor"
        return ""

    def _charge_warning(self) -> str:
        """Return that the pack is emptier than it should be, empty if it is not."""
        charge = self._trip.step.state.state_of_charge
        lowest = self._trip.parameters.charge.min_charge
        return (
            f"state of charge is {charge:.1%}, below soc_min, {lowest:.1%}"
            if charge < lowest
            else ""
        )

    def _outcome(self) -> tuple[Level, str]:
        if self.exit_code == EXIT_PACK_EMPTY:
            return Level.ERROR, "the pack is empty"
        if self._failure:
            return Level.ERROR, "the vehicle model failed"
        if self._controller_lost:
            return Level.ERROR, "finished without a controller"
        return Level.OK, "finished"


def main() -> None:
    """Run the node."""
    sys.exit(node_main(PLANT, PlantNode, PlantNodeParameters))


if __name__ == "__main__":
    main()
