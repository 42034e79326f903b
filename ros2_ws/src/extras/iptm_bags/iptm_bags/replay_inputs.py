"""Recorded inputs and parameters for the check of one node, tick by tick."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from contextlib import nullcontext, suppress
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from iptm_core.declaration import given_settings
from iptm_core.errors import BagError
from iptm_core.road_ahead import RoadAheadSettings
from iptm_core.settings import LeaderSource, LoopMode
from iptm_ros.assembly import split_trips
from iptm_ros.recording.bag_reader import BagReader
from iptm_ros.recording.timeline import read_stamp_ns
from iptm_ros.recording.trajectory_reader import refuse_changed_settings, topic_name
from iptm_ros.topics import (
    BRIDGE,
    CONTROLLER,
    PLANT,
    Topic,
)

OUTPUTS: Mapping[str, tuple[Topic, ...]] = {
    CONTROLLER: (
        Topic.SOLVE, Topic.PLAN, Topic.COMMAND,
    ),
    BRIDGE: (
        Topic.SLOPE, Topic.ROAD_AHEAD, Topic.LEADER, Topic.LEADER_SAMPLES, Topic.LEADER_PREVIEW,
    ),
    PLANT: (
        Topic.PLANT_STATE, Topic.PLANT_ODOMETRY, Topic.PLANT_ACCELERATION, Topic.PLANT_BATTERY,
        Topic.PLANT_CELL_1_TEMPERATURE, Topic.PLANT_CELL_N_TEMPERATURE,
        Topic.PLANT_COOLANT_INLET_TEMPERATURE, Topic.PLANT_COOLANT_OUTLET_TEMPERATURE, Topic.CLOCK,
    ),
}  # fmt: skip
"""Compared outputs of each node; its diagnostics depend on the machine and are left out."""

INPUTS: Mapping[str, tuple[Topic, ...]] = {
    CONTROLLER: (
        Topic.SLOPE,
        Topic.PLANT_STATE,
        Topic.ROAD_AHEAD,
        Topic.LEADER,
        Topic.LEADER_PREVIEW,
        Topic.ROAD_FRICTION,
        Topic.ENGAGEMENT,
        Topic.ARRIVAL_COST,
    ),
    BRIDGE: (Topic.CLOCK,),
    PLANT: (Topic.LEADER_SAMPLES, Topic.LEADER_PREVIEW, Topic.COMMAND),
}
"""Recorded inputs of each node; a bridge on received messages also needs the position of the ego vehicle."""

_NEWEST = (Topic.ROAD_FRICTION, Topic.ENGAGEMENT, Topic.ARRIVAL_COST)
"""Topics without the stamp of a tick: what counts is the newest message before its final answer."""
_NOT_ALWAYS = (Topic.LEADER, *_NEWEST)
"""Topics that not every bag has: no leader on an empty road, no friction where it is not published."""
FINAL_ANSWER = {CONTROLLER: Topic.COMMAND, BRIDGE: Topic.LEADER_PREVIEW, PLANT: Topic.CLOCK}
_OWN_WAY: Mapping[str, Mapping[str, Any]] = {
    # The check is the only subscriber, and its inputs are never late.
    CONTROLLER: {"input_timeout_s": 60.0},
    BRIDGE: {},
    PLANT: {"command_timeout_wall_s": 3600.0, "linger_s": 1.0, "start_paused": True},
}


@dataclass(frozen=True)
class Recorded:
    """Recorded inputs and parameters of one node.

    Attributes:
        names: full names of the topics.
        namespace: of the node.
        parameters: of the node.
        steps: inputs of each tick by topic, by the stamp (ns) of the final answer, in order. Friction of the
            road and engagement are the newest ones recorded before that answer.
    """

    names: Mapping[Topic, str]
    namespace: str
    parameters: Mapping[str, Any]
    steps: Mapping[int, Mapping[Topic, bytes]]


def read_recorded(bag: Path, node: str, namespace: str | None = None) -> Recorded:
    """Read the inputs and the parameters of a node.

    Args:
        bag: bag folder or file.
        node: one of `NODES`.
        namespace: of the vehicle; needed only if the bag holds several.

    Raises:
        BagError: the bag cannot be read, lacks a topic or the parameters, or cannot be repeated.
    """
    with BagReader(bag) as reader:
        text = reader.run_information().parameters
        given = (yaml.safe_load(text) or {}).get(node)
        if not isinstance(given, dict):
            raise BagError(
                f"{bag} does not hold the parameters of {node}: there is nothing to start it with"
            )
        inputs, own_way = _inputs_and_changes(node, given, bag)
        wanted = dict.fromkeys((*inputs, *OUTPUTS[node]))
        names = {}
        for topic in wanted:
            with suppress(BagError) if topic in _NOT_ALWAYS else nullcontext():
                names[topic] = topic_name(reader, topic, namespace)
        topics = {name: topic for topic, name in names.items()}
        heard, answered = _heard(reader, topics, FINAL_ANSWER[node])
    trips = len(split_trips([(stamp_ns, None) for stamp_ns in answered]))
    if trips > 1:
        raise BagError(f"{bag} holds {trips} trips; allowed: one, as a check begins with the start")
    if node == CONTROLLER:
        refuse_changed_settings(bag, namespace)
    if node == PLANT and given.get("mode", "lock_step") != LoopMode.LOCK_STEP.value:
        raise BagError(
            f"mode of {bag} is {given['mode']}; allowed: lock_step, as a plant on the wall clock"
            " applies commands when they arrive"
        )
    own_topic = OUTPUTS[node][0]
    return Recorded(
        names=names,
        namespace=names[own_topic].removesuffix(own_topic.value).rstrip("/") or "/",
        parameters={**given, **own_way},
        steps=_steps(node, inputs, heard, bag),
    )


def _heard(
    reader: BagReader, topics: Mapping[str, Topic], final_answer: Topic
) -> tuple[dict[Topic, dict[int, bytes]], list[int]]:
    """Return the messages by topic and stamp (ns), and the stamps of the final answers as they came."""
    heard: dict[Topic, dict[int, bytes]] = {topic: {} for topic in topics.values()}
    answered: list[int] = []
    newest: dict[Topic, bytes] = {}
    for raw in reader.raw_messages(list(topics)):
        topic = topics[raw.topic]
        if topic in _NEWEST:
            newest[topic] = raw.data
            continue
        stamp_ns = 0 if topic is Topic.SLOPE else read_stamp_ns(raw.data)
        if stamp_ns is None:
            continue
        heard[topic][stamp_ns] = raw.data
        if topic is final_answer:
            answered.append(stamp_ns)
            for kind, data in newest.items():
                heard[kind][stamp_ns] = data
    return heard, answered


def _inputs_and_changes(
    node: str, given: Mapping[str, Any], bag: Path
) -> tuple[tuple[Topic, ...], dict[str, Any]]:
    """Return the inputs of a node with such parameters, and the parameters that differ in a check."""
    inputs, own_way = INPUTS[node], dict(_OWN_WAY[node])
    if node == BRIDGE:
        road = given_settings(RoadAheadSettings, given)
        is_cam = road.leader_source is LeaderSource.CAM
        if road.leader_source in {LeaderSource.RANGE_SENSOR, LeaderSource.RANGE_SENSOR_AND_CAM}:
            raise BagError(
                f"{bag} has leader_source {road.leader_source.value}, whose measurements are not joined "
                "by stamp; allowed: bags of the other sources"
            )
        if is_cam or road.keeps_rules:
            inputs = (Topic.PLANT_STATE, *inputs)
        if is_cam:
            own_way |= {"recorded_packets": str(bag.resolve()), "publish_datagrams": False}
    return inputs, own_way


def _steps(
    node: str, inputs: Collection[Topic], heard: Mapping[Topic, Mapping[int, bytes]], bag: Path
) -> dict[int, dict[Topic, bytes]]:
    final_answer = FINAL_ANSWER[node]
    answers = sorted(heard[final_answer])
    if not answers:
        raise BagError(
            f"{bag} holds no message of {final_answer.value}: there is nothing to compare"
        )

    def inputs_at(stamp: int) -> dict[Topic, bytes]:
        stamped = [topic for topic in inputs if topic not in (Topic.SLOPE, *_NEWEST)]
        return {topic: heard[topic][stamp] for topic in stamped if stamp in heard[topic]}

    def newest_at(stamp: int) -> dict[Topic, bytes]:
        # Repeated at every tick: friction counts for 60 s of wall time only.
        return {topic: heard[topic][stamp] for topic in _NEWEST if stamp in heard.get(topic, ())}

    if node == PLANT:
        if answers[0] != 0:
            raise BagError(
                f"{bag} begins at {answers[0] * 1e-9:g} s of the trip; allowed: 0 s, where the state"
                " of the vehicle is known"
            )
        # A state is the answer to what was received one tick before.
        commands = heard[Topic.COMMAND]
        return {0: {}} | {
            stamp: newest_at(stamp) | inputs_at(before) | {Topic.COMMAND: commands.get(before, b"")}
            for before, stamp in pairwise(answers)
        }
    steps = {stamp: newest_at(stamp) | inputs_at(stamp) for stamp in answers}
    if Topic.SLOPE in inputs:
        steps[answers[0]] = {Topic.SLOPE: heard[Topic.SLOPE][0], **steps[answers[0]]}
    return steps
