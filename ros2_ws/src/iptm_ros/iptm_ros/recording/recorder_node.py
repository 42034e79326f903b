"""The recorder: subscribes to raw bytes and hands them to the bag, nothing more.

Every tick is in the file before the first message of the next one, and everything a moment later,
so that a killed recorder loses one tick at most. On a stop it first empties its queues.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from iptm_core.declaration import Scalar
from iptm_core.errors import BagError
from iptm_core.program import EXIT_USER_ERROR
from iptm_ros.codecs import s_from_ns
from iptm_ros.diagnostics import DiagnosticsReporter, Level
from iptm_ros.recording.bag_writer import BagWriter
from iptm_ros.recording.mcap_file import FileLimits
from iptm_ros.recording.recorded_topics import QosOverrides, TopicSelection
from iptm_ros.recording.run_information import LOST_KEY, PAUSES_KEY, RunInformation
from iptm_ros.recording.session import RecordingSession
from iptm_ros.recording.subscriptions import ParameterCollector, TopicSubscriber, with_model
from iptm_ros.recording.timeline import CLOCK_TYPE, Timeline, TimeSource, with_clock
from iptm_ros.services import Service
from iptm_ros.suite_node import SuiteNode
from iptm_ros.topics import Topic

READY_LINE = "recorder ready"
DEFAULT_DEPTH = 10_000
CLOCK_PATIENCE_S = 1.0
"""Time after the first message of a trip in which its clock must come."""
_LOOK_PERIOD_S = 0.05
_ADAPTION_PERIOD_S = 1.0
_IDLE_BEFORE_CLOSING_S = 0.1
_LONGEST_DRAIN_S = 1.0
_PROGRESS_PERIOD_S = 10.0


@dataclass(frozen=True)
class RecorderOptions:
    """What to record, and how.

    Attributes:
        output: bag folder to create.
        in_existing_folder: the folder exists and holds no bag.
        selection: topics wanted; without discovery, of the suite's topic table.
        discover: take topics from the graph as they appear, not from the topic table.
        time_source: simulated time from `/clock`, or wall time.
        run_information: what the run depends on.
        compression: "none", "lz4" or "zstd".
        limits: of one file of the bag.
        depth: messages queued per topic while the recorder is busy.
        is_paused: begin paused.
        qos: quality of service requested by the user, by full names of topics.
        repeats: whether topics that repeat others are written from those instead of being subscribed to.
        also: types of further topics, by name.
    """

    output: Path
    selection: TopicSelection = field(default_factory=TopicSelection)
    discover: bool = False
    time_source: TimeSource = TimeSource.SIMULATED
    run_information: RunInformation = field(default_factory=RunInformation)
    compression: str = "none"
    limits: FileLimits = field(default_factory=FileLimits)
    depth: int = DEFAULT_DEPTH
    is_paused: bool = False
    qos: QosOverrides = field(default_factory=dict)
    in_existing_folder: bool = False
    repeats: bool = False
    also: Mapping[str, str] = field(default_factory=dict)


class RecorderNode(SuiteNode):
    """Records until `stop` is called; then drains, closes the bag and finishes.

    Raises:
        BagError: the output exists or cannot be created, or the clock is excluded.
    """

    def __init__(self, options: RecorderOptions, **node_options: Any) -> None:
        super().__init__("recorder", **node_options)
        self._options = options
        clock_topic = self.resolve_topic_name(Topic.CLOCK.value)
        selection = options.selection
        self._clock_topic = clock_topic
        self._data_since_s: float | None = None
        if options.time_source is TimeSource.SIMULATED:
            selection = with_clock(selection, clock_topic)
        self._writer = BagWriter(
            options.output,
            custom_data=options.run_information.to_custom_data(),
            compression=options.compression,
            limits=options.limits,
            in_existing_folder=options.in_existing_folder,
        )
        self._session = RecordingSession(self._writer, Timeline(options.time_source), clock_topic)
        self._topics = TopicSubscriber(
            self,
            self._session,
            selection,
            discover=options.discover,
            depth=options.depth,
            on_error=self._fail,
            qos=options.qos,
            repeats=options.repeats,
            also=options.also,
        )
        if options.is_paused:
            self._session.pause()
        # A run that was started by hand is asked what it depends on.
        self._collector = (
            None
            if options.run_information.parameters
            else ParameterCollector(self, self._store_parameters)
        )
        self._stop_time_s: float | None = None
        self._looks_since_stop = 0
        self._closed = False
        self._seen_count = 0
        self._last_arrival_s = time.monotonic()
        self._next_adaption_s = 0.0
        self._next_progress_s = time.monotonic() + _PROGRESS_PERIOD_S
        self._diagnostics = DiagnosticsReporter.of_node(self, "recording")
        self.serve(Service.RECORDER_PAUSE, self._pause)
        self.serve(Service.RECORDER_RESUME, self._resume)
        self.serve(Service.RECORDER_SPLIT, self._split)
        self._topics.look()
        self.every(_LOOK_PERIOD_S, self._look)
        print(f"recording to {options.output}")
        print(READY_LINE, flush=True)

    def stop(self) -> None:
        """Ask for the end of the recording, which comes when the queues are empty."""
        if self._stop_time_s is None:
            self._stop_time_s = time.monotonic()

    def destroy_node(self) -> None:
        """Close the bag, should that not have happened yet, and destroy the node."""
        self._close()
        self._topics.close()
        super().destroy_node()

    def _pause(self) -> str:
        self._session.pause()
        self._store_pauses()
        return "pauses after the present tick"

    def _resume(self) -> str:
        self._session.resume()
        self._store_pauses()
        return "records from the next tick on"

    def _split(self) -> str:
        return f"goes on in {self._writer.split().name}"

    def _store_pauses(self) -> None:
        """Write the intentional gaps of the recording into the bag."""
        pauses = [
            {
                "after_s": s_from_ns(pause.after_ns) if pause.after_ns >= 0 else None,
                "until_s": None if pause.until_ns is None else s_from_ns(pause.until_ns),
                "passed_over": pause.passed_over,
            }
            for pause in self._session.pauses
        ]
        text = yaml.safe_dump(pauses, sort_keys=False, default_flow_style=True, width=math.inf)
        self._writer.add_information({PAUSES_KEY: text.strip()})

    def _look(self) -> None:
        """Do periodic work other than storing messages, a few times a second."""
        now_s = time.monotonic()
        if self._session.message_count != self._seen_count:
            self._seen_count = self._session.message_count
            self._last_arrival_s = now_s
        try:
            self._session.flush()
        except BagError as error:
            self._fail(error)
        if self._stop_time_s is not None:
            self._looks_since_stop += 1
            if self._is_drained(now_s - self._stop_time_s, now_s - self._last_arrival_s):
                self._close()
                self.finish(self.exit_code)
            return
        self._topics.look()
        if self._topics.has_data and self._session.now_ns is None:
            self._await_clock(now_s)
        if self._collector is not None:
            self._collector.look()
        if now_s >= self._next_adaption_s or not self._topics.has_data:
            self._next_adaption_s = now_s + _ADAPTION_PERIOD_S
            self._topics.count_lost()
            self._topics.adapt()
        if now_s >= self._next_progress_s:
            self._next_progress_s = now_s + _PROGRESS_PERIOD_S
            print(self._progress(), flush=True)
        self._report()

    def _await_clock(self, now_s: float) -> None:
        """Give up waiting for a clock that has not come with the messages of a trip."""
        if self._data_since_s is None:
            self._data_since_s = now_s
        if now_s - self._data_since_s < CLOCK_PATIENCE_S:
            return
        self._session.stop_waiting()
        clocks = [name for name, types in self.get_topic_names_and_types() if CLOCK_TYPE in types]
        others = sorted(name for name in clocks if self.count_publishers(name))
        hint = f"; choose one with --ros-args -r clock:=NAME: {', '.join(others)}" if others else ""
        self.get_logger().warning(
            f"no clock at {self._clock_topic}: the bag is ordered by time of reception{hint}"
        )

    @property
    def _lacks_clock(self) -> bool:
        is_wanted = self._options.time_source is TimeSource.SIMULATED
        return is_wanted and self._session.is_ordered_by_reception

    def _is_drained(self, stopping_s: float, idle_s: float) -> bool:
        """Return whether everything that was received before the request to stop has been written.

        The executor works in the order of arrival: by the second look after the request, all that
        was queued at the first one is done, however large the backlog. A moment more is given to
        what was on its way between processes, as long as it does not go on for ever.
        """
        if self._looks_since_stop < 2:
            return False
        return min(idle_s, stopping_s) > _IDLE_BEFORE_CLOSING_S or stopping_s > _LONGEST_DRAIN_S

    def _report(self) -> None:
        is_recording = self._topics.has_data
        is_paused = self._session.is_paused
        level, reason = Level.OK, "recording" if is_recording else "waiting for data"
        if is_paused:
            level, reason = Level.WARN, "paused: nothing is recorded"
        elif self._lacks_clock:
            level, reason = Level.WARN, "no clock: the bag is ordered by time of reception"
        if self._topics.lost_counts:
            level, reason = Level.WARN, "messages were lost: the recorder was too slow or stopped"
        self._diagnostics.report(self._session.now_ns or 0, level, reason, self._values)

    def _values(self) -> dict[str, object]:
        is_recording = self._topics.has_data
        is_paused = self._session.is_paused
        return {
            "phase": "paused" if is_paused else "recording" if is_recording else "waiting",
            "bag": str(self._options.output),
            "messages": self._session.message_count,
            "topics": len(self._session.message_counts),
            "clock": "none"
            if self._session.now_ns is None or self._lacks_clock
            else self._clock_topic,
            "subscriptions": self._topics.subscribed_count,
            "subscriptions_matched": self._topics.matched_count,
            "awaited_topics": ", ".join(self._topics.awaited_topics),
            "lost_messages": sum(self._topics.lost_counts.values()),
            "passed_over_messages": sum(pause.passed_over for pause in self._session.pauses),
            "parameters_of": ", ".join(self._collector.nodes) if self._collector else "the run",
        }

    def _progress(self) -> str:
        now_ns = self._session.now_ns
        at = "" if now_ns is None else f", at {now_ns * 1e-9:.1f} s"
        passed_over = sum(pause.passed_over for pause in self._session.pauses)
        paused = f", {passed_over} passed over in pauses" if self._session.pauses else ""
        return f"recorded {self._session.message_count - passed_over} messages{at}{paused}"

    def _store_parameters(self, by_node: Mapping[str, Mapping[str, Scalar]]) -> None:
        text = yaml.safe_dump(with_model(by_node), sort_keys=False)
        try:
            self._writer.add_information({"parameters": text})
        except BagError as error:
            self._fail(error)

    def _fail(self, error: BagError) -> None:
        """Give up on an error of the disk; the bag so far can still be read or recovered."""
        if self.exit_code == 0:
            print(f"recorder: {error}", file=sys.stderr, flush=True)
            self.finish(EXIT_USER_ERROR)

    def _close(self) -> None:
        if self._closed:
            return
        self._closed = True
        self._topics.count_lost()
        lost = self._topics.lost_counts
        try:
            if lost:
                self._writer.add_information({LOST_KEY: yaml.safe_dump(lost)})
            if self._session.pauses:
                self._store_pauses()
            self._session.close()
        except BagError as error:
            self._fail(error)
            return
        print(f"{self._progress()}; closed {self._options.output}", flush=True)
        for name in self._topics.unused_overrides:
            print(
                f"recorder: quality of service of {name} was not used: no such topic",
                file=sys.stderr,
            )
        if lost:
            counts = ", ".join(f"{count} of {name}" for name, count in sorted(lost.items()))
            print(f"recorder: {sum(lost.values())} messages lost: {counts}", file=sys.stderr)
