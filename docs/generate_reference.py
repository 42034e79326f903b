"""Writes docs/reference/*.md and the parameter files of the nodes from the code.

Run it through ``scripts/update_docs``; a test fails when the committed pages are out of date.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from pathlib import Path

from interface_reference import NOTICE, services_page, table, topics_page
from library_reference import library_page

import iptm_bringup
from iptm_bringup.composition import parameter_file_text
from iptm_bringup.scenario import BRIDGE, CONTROLLER, PLANT
from iptm_controller.node_parameters import CHANGEABLE, ControllerNodeParameters
from iptm_controller.production import ProductionSettings
from iptm_controller.solvers.interface import STATUS_TEXT
from iptm_controller.strategy import COST_TERMS, DEFAULT_STRATEGY, STRATEGIES
from iptm_core.declaration import parameter_specs, plain
from iptm_core.metrics import FIGURES
from iptm_core.parameters import available_parameter_sets, describe_parameters, load_parameters
from iptm_faults.fault import Fault
from iptm_faults.kinds import FaultKind
from iptm_interfaces.visual_topics import PUBLISHER
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_v2x_bridge.node_parameters import BridgeNodeParameters, SenderNodeParameters
from iptm_view.visualizer_parameters import VisualizerParameters

DOCS = Path(__file__).resolve().parent
CONFIG = Path(iptm_bringup.__file__).parent / "config" / "nodes"
COST_TO_GO = "../explanation/optimal-control.md#the-cost-to-go-of-the-temperatures"
PRODUCTION = """\
adaptive cruise control and a thermostat with hysteresis. The acceleration is k1 (gap - standstill gap - T
v) + k2 (lead vehicle's speed - v), the lower one of the gains for following and those for closing a large
gap, and at most 0.4/s times the difference to the largest speed; limits of acceleration and jerk are those
of the car. Gains: V. Milanés, S. E. Shladover, Transportation Research Part C 48 (2014) 285-300, and L.
Xiao, M. Wang, B. van Arem, Transportation Research Record 2623 (2017) 1-9, also the defaults of the model
ACC in SUMO; the time gap T lies in the range of ISO 15622:2018. Where the lead vehicle brakes harder than
the limits of comfort allow, the collision guard and the safety monitor brake, as emergency braking does in
cars. Makers publish no thresholds of their thermostats: those below are chosen, in the middle of the
paper's limits of 25 and 40 degC."""


def parameters_page() -> str:
    """Every model parameter of every shipped set with its unit, range and source."""
    parts = [f"# Model parameters\n\n{NOTICE}"]
    for name in available_parameter_sets():
        parts.append(f"## `{name}`\n\n")
        rows = (
            (
                f"`{row.key}`",
                row.symbol,
                f"{row.value:.10g}",
                row.unit,
                f"{row.minimum:g} to {row.maximum:g}",
                f"{row.source}: {row.note}" if row.note else row.source,
            )
            for row in describe_parameters(load_parameters(name))
        )
        parts += [table(("key", "symbol", "value", "unit", "range", "source"), rows), "\n"]
    return "".join(parts)


NODES = {
    PLANT: (
        PlantNodeParameters,
        "Simulated vehicle, battery and cooling; the master of time.",
    ),
    BRIDGE: (
        BridgeNodeParameters,
        "The leader and the prediction of its motion, with everything that goes wrong on the radio link.",
    ),
    CONTROLLER: (
        ControllerNodeParameters,
        "Multi-horizon model predictive control of acceleration and compressor power.",
    ),
}


CHANGEABLE_NOTE = (
    f"May be [set while driving](../how-to/README.md#change-strategy-weights-or-horizon-while-driving): "
    f"{', '.join(f'`{name}`' for name in CHANGEABLE)}.\n\n"
)


def nodes_page() -> str:
    """Parameters of the three nodes, of the sender of messages and of the visualizer."""
    parts = [f"# Node parameters\n\n{NOTICE}"]
    others = {"v2x_sender": (SenderNodeParameters, ""), PUBLISHER: (VisualizerParameters, "")}
    for node, (parameters, _) in (NODES | others).items():
        note = CHANGEABLE_NOTE if node == CONTROLLER else ""
        rows = (
            (
                f"`{spec.name}`",
                f"`{plain(spec.default)}`",
                spec.unit or "-",
                spec.allowed,
                spec.description,
            )
            for spec in parameter_specs(parameters)
        )
        shown = table(("parameter", "default", "unit", "allowed", "meaning"), rows)
        parts.append(f"## `{node}`\n\n{note}{shown}\n")
    return "".join(parts)


def node_file(node: str) -> str:
    """The parameter file of a node: every default, with its meaning."""
    parameters, about = NODES[node]
    specs = parameter_specs(parameters)
    header = (
        f"# {about}\n# Made by scripts/update_docs from the code. These are the defaults; "
        "`ros2 param describe` and `--help`\n# of the node show the permitted ranges.\n"
    )
    return header + parameter_file_text(
        node,
        {spec.name: plain(spec.default) for spec in specs},
        {spec.name: spec.description + (f" [{spec.unit}]" if spec.unit else "") for spec in specs},
    )


def strategies_page() -> str:
    """The strategies and the solver outcomes."""
    heads = ("strategy", "weights", "cost to go")
    rows = (
        (
            f"`{s.name}`",
            ", ".join(
                f"{COST_TERMS[key].symbol} = {weight:g}"
                for key, weight in s.weights.items()
                if weight
            ),
            "yes" if s.cost_to_go else "no",
        )
        for s in STRATEGIES.values()
        if not s.is_rule_based
    )
    laws = (
        (f"`{spec.name}`", str(spec.default), spec.unit or "1", spec.description)
        for spec in parameter_specs(ProductionSettings)
    )
    outcomes = ((status.value, status.name, text) for status, text in STATUS_TEXT.items())
    return (
        f"# Strategies and outcomes\n\n{NOTICE}Weights of the cost terms, zero where none is given; "
        "the [parameters of the controller](nodes.md#controller) state terms and units. The default is "
        f"`{DEFAULT_STRATEGY}`. Its [cost to go]({COST_TO_GO}) prices the cell temperatures at the end of "
        "the horizon and has no weight.\n\n"
        + table(heads, rows)
        + "\n## What cars have today\n\n`production` optimises nothing and uses no preview, to compare with: "
        f"{PRODUCTION}\n\n"
        + table(("parameter", "value", "unit", "meaning"), laws)
        + "\n## Outcomes of a solve\n\n"
        + table(("code", "status", "meaning"), outcomes)
    )


def figures_page() -> str:
    """Every figure of a run that tables, pictures, files and the report show."""
    rows = (
        (f"`{key}`", figure.label, figure.symbol or "-", figure.unit or "1")
        for key, figure in FIGURES.items()
    )
    return (
        f"# Figures of a run\n\n{NOTICE}The same figures stand on the terminal, in `results.json`, in "
        "`scripts/bag_info`, in the CSV files of the studies and in the report.\n\n"
        + table(("key", "figure", "symbol", "unit"), rows)
    )


def faults_page() -> str:
    """Every kind of fault, and the keys of one."""
    allowed = {"kind": "one of those below", "size": "see the kind"}
    defaults = {"size": "that of the kind", "target": "see the kind"}
    keys = (
        (
            f"`{spec.name}`",
            defaults.get(spec.name) or f"`{plain(spec.default)}`",
            spec.unit or "-",
            allowed.get(spec.name, spec.allowed).replace("one of , ", "one of "),
            spec.description,
        )
        for spec in parameter_specs(Fault)
    )
    kinds = []
    for kind in FaultKind:
        spec = kind.spec
        size = bounds = "-"
        if spec.has_size:
            size = f"{spec.size:g} {spec.unit}"
            bounds = f"{spec.smallest:g} to {spec.largest:g}"
        where = "yes" if spec.headless else "no"
        kinds.append((f"`{kind}`", spec.place.value, spec.meaning, size, bounds, where))
    return (
        f"# Faults\n\n{NOTICE}Keys of one fault in the list `faults` of a scenario; how to use it: "
        "[inject faults](../how-to/README.md#inject-faults).\n\n"
        + table(("key", "default", "unit", "allowed", "meaning"), keys)
        + "\n## Kinds\n\nIn `traffic` the leader that counts behaves otherwise, in `vehicle` the ego "
        "vehicle; all others change only what the nodes receive, or the nodes themselves.\n\n"
        + table(("kind", "where", "what it does", "size", "allowed", "without ROS"), kinds)
    )


PAGES = {
    DOCS / "reference" / "faults.md": faults_page,
    DOCS / "reference" / "figures.md": figures_page,
    DOCS / "reference" / "library.md": partial(library_page, NOTICE),
    DOCS / "reference" / "services.md": services_page,
    DOCS / "reference" / "topics.md": topics_page,
    DOCS / "reference" / "parameters.md": parameters_page,
    DOCS / "reference" / "nodes.md": nodes_page,
    DOCS / "reference" / "strategies.md": strategies_page,
    **{CONFIG / f"{node}.yaml": partial(node_file, node) for node in NODES},
}


def main() -> int:
    """Write the pages, or with ``--check`` compare them with what is committed."""
    parser = argparse.ArgumentParser(description="Write docs/reference from the code.")
    parser.add_argument("--check", action="store_true", help="write nothing, fail when out of date")
    check = parser.parse_args().check
    stale = []
    for path, page in PAGES.items():
        text = page()
        if check:
            if not path.exists() or path.read_text(encoding="utf-8") != text:
                stale.append(path.name)
        else:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
    if stale:
        print(f"out of date: {', '.join(stale)}; run scripts/update_docs", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
