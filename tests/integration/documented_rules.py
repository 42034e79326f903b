"""How each documented command line is executed, or why it is not."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum


class Way(Enum):
    """How a command line is executed."""

    RUN = "to its end"
    ASK = "beside running nodes"
    RECORD = "until it is ready, then Ctrl-C"
    SERVE = "likewise, by the slow tests"
    DRIVE = "on a short trip"
    PREPARE = "up to the prepared trip"
    ELSEWHERE = "by another test"
    NOT = "not executed"


@dataclass(frozen=True)
class Rule:
    """What is done with the command lines that match a pattern; the first rule that matches counts.

    Attributes:
        way: how they are executed.
        pattern: of the whole command line.
        extra: options behind the documented ones, {out} is a new path; or the reason or the other test.
        node: of a command that ends with Ctrl-C: the node that is on the graph when the command is ready; ""
            for a printed address.
    """

    way: Way
    pattern: str
    extra: str = ""
    node: str = ""


_SHORT = "--duration-s 3 --no-picture --against none"

RULES = (
    # Parts to be filled in, or names of programs in a sentence.
    Rule(
        Way.NOT,
        r".*(\[|\.\.\.|\bFILE\b|FIRST| \| |/play|\b(NODES|COMMAND|FOLDER)\b).*",
        "a pattern, with parts to be filled in",
    ),
    Rule(
        Way.NOT,
        r"(ros2|python3) (topic|bag|param|is)( record| play.*| .* needed)?",
        "part of a sentence",
    ),
    Rule(
        Way.NOT,
        r"scripts/iptm (check controller|traffic --fcd|compare --exact|(?!view|visualize)\w+)",
        "an option in a sentence",
    ),
    # What a test must not do, or what is not there.
    Rule(
        Way.NOT,
        r"(ros2 (run|launch|security)|rviz2|rosdep|colcon build).*",
        "a full ROS 2 installation",
    ),
    Rule(
        Way.NOT,
        r".*pip install .*|scripts/dev (locks|example_bag|version|release).*",
        "changes the environment, over the network",
    ),
    Rule(
        Way.NOT,
        r"scripts/test.*|.*pre_commit.*|IPTM_PYTHON=\S+ scripts/test",
        "these tests themselves",
    ),
    Rule(
        Way.NOT,
        r"scripts/iptm traffic.*|scripts/iptm view bags/traffic|.*main_7",
        "SUMO, requirements/traffic.txt",
    ),
    Rule(Way.NOT, r"python -m tests.extras.iptm_view.screenshot", "a browser"),
    Rule(Way.NOT, r".*(ROS_SECURITY|--enclave).*", "DDS security, which the wheels lack"),
    Rule(Way.NOT, r"export .*", "sets a variable"),
    Rule(
        Way.NOT,
        r".*start_state:=.*",
        "files of a run; tests/integration/test_trip_control.py has them",
    ),
    Rule(Way.ELSEWHERE, r"colcon test|source ros2_ws/install.*", "tests/packaging/test_colcon.py"),
    Rule(Way.ELSEWHERE, r"(IPTM_\w+=\S+ )?scripts/setup.*", "tests/packaging/test_setup.py"),
    Rule(Way.ELSEWHERE, r".*python -m pythonfmu build .*", "tests/studies/test_benchmark_kinds.py"),
    Rule(
        Way.ELSEWHERE,
        r"python docs/examples/commute.py .*|scripts/iptm drive show my_commute.csv",
        "tests/packaging/test_newcomer.py",
    ),
    Rule(
        Way.ELSEWHERE,
        r"python docs/examples/.*|scripts/(controller|v2x_bridge)|scripts/run_demo --without .*",
        "tests/integration/test_own_nodes.py",
    ),
    Rule(
        Way.ELSEWHERE,
        r"(scripts/study|python -m studies\.).*",
        "tests/studies/test_studies.py",
    ),
    Rule(
        Way.ELSEWHERE,
        r"scripts/iptm codegen .*|cmake .*|ecu/build/bench .*|cp studies/embedded/cortex_m7\.c ecu",
        "tests/extras/iptm_ecu/test_codegen.py and tests/studies/test_embedded.py",
    ),
    Rule(
        Way.ELSEWHERE,
        r"python -m iptm_vehicle_interface\..*|scripts/run_demo --vehicle .*|python -m can\..*",
        "tests/extras/iptm_vehicle_interface/test_bench.py, or a bus that is not there",
    ),
    Rule(
        Way.ELSEWHERE, r"scripts/iptm meter .*", "tests/extras/iptm_vehicle_interface/test_meter.py"
    ),
    Rule(
        Way.ELSEWHERE,
        r"scripts/iptm (fmu .*|run --set vehicle\.plant=.*)|python -m tests\.extras\.iptm_fmi\.speed",
        "tests/extras/iptm_fmi",
    ),
    Rule(
        Way.ELSEWHERE,
        r"python -m iptm_plan\.node .*|scripts/iptm record --topics /planner/plan .*",
        "tests/extras/iptm_plan/integration",
    ),
    Rule(
        Way.ELSEWHERE,
        r"python -m iptm_cabin\.cycle_fit",
        "tests/extras/iptm_cabin/test_cycle_map.py, where CoolProp is",
    ),
    Rule(Way.ELSEWHERE, r"scripts/dev (build|docs|site).*", "tests/packaging"),
    Rule(Way.NOT, r"dask .*|.*dask worker .*", "an extra, on several machines"),
    # Seconds.
    Rule(Way.ASK, r"(scripts/iptm (call|param)|ros2 (service|param)) .*"),
    Rule(Way.RUN, r"source scripts/env.sh"),
    Rule(Way.NOT, r"scripts/iptm judge RUN.*", "a pattern, with parts to be filled in"),
    Rule(Way.RUN, r"scripts/iptm ((info|judge|compare|recover|export|drive|plan|learn) .*|--help)"),
    Rule(Way.RUN, r"scripts/run_demo --list"),
    # Longer.
    Rule(Way.RECORD, r"scripts/iptm record .*", node="recorder"),
    Rule(Way.SERVE, r"scripts/iptm replay .*", node="player"),
    Rule(Way.SERVE, r"scripts/iptm view.*", "--no-browser"),
    Rule(Way.SERVE, r"scripts/iptm visualize.*", node="visualizer"),
    Rule(Way.SERVE, r"scripts/plant .*", node="plant"),
    Rule(Way.SERVE, r"scripts/v2x_bridge .*", node="v2x_bridge"),
    Rule(Way.SERVE, r"scripts/controller .*", node="controller"),
    Rule(Way.SERVE, r"scripts/iptm send .*", node="v2x_sender"),
    Rule(Way.DRIVE, r"scripts/iptm check .*"),
    Rule(
        Way.DRIVE, r"scripts/iptm run --vehicles .*", "--duration-s 3 --against none --output {out}"
    ),
    Rule(Way.DRIVE, r"scripts/run_demo .*--output.*", _SHORT),
    Rule(Way.PREPARE, r"scripts/run_demo (?!.*(--view|--without|--set|my_plan)).*"),
    Rule(
        Way.DRIVE,
        r"(IPTM_COMPILER=none )?scripts/(run_demo|iptm run).*",
        f"{_SHORT} --output {{out}}",
    ),
)


def rule_for(command: str) -> Rule | None:
    """Return the rule of a command line, None where there is none."""
    return next((rule for rule in RULES if re.fullmatch(rule.pattern, command)), None)
