"""Writes docs/reference/*.md and the parameter files of the nodes from the code.

Run it through ``scripts/dev docs``; a test fails when the committed pages are out of date.
"""

from __future__ import annotations

import argparse
import sys
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from interface_reference import TEMPLATES, services_page, topics_page
from library_reference import library_page
from schemas import trip_schema, vehicle_schema

import iptm.runner
from iptm.commands.tree import all_commands
from iptm.faults.fault import Fault
from iptm.faults.kinds import FaultKind
from iptm.runner.composition import parameter_file_text
from iptm_controller.node_parameters import CHANGEABLE, ControllerNodeParameters
from iptm_controller.production import SIMPLE, ProductionSettings
from iptm_controller.solvers.interface import STATUS_TEXT
from iptm_controller.strategy import COST_TERMS, DEFAULT_STRATEGY, STRATEGIES
from iptm_core.declaration import parameter_specs, plain
from iptm_core.markdown import render_page
from iptm_core.metrics.figures import FIGURES, SAVINGS, WORTH
from iptm_core.parameters import available_parameter_sets, describe_parameters, load_parameters
from iptm_core.parameters.catalogue import cars
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_ros.topics import BRIDGE, CONTROLLER, PLANT
from iptm_v2x_bridge.node_answers import BridgeNodeParameters

DOCS = Path(__file__).resolve().parent
CONFIG = Path(iptm.runner.__file__).parent / "config" / "nodes"
METER, VIEW, ITS = "iptm_vehicle_interface", "iptm_view", "iptm_its"
EXTRAS = (
    METER,
    "iptm_drives",
    "iptm_bags",
    "iptm_ecu",
    "iptm_fmi",
    ITS,
    "iptm_judges",
    "iptm_life",
    "iptm_plan",
    "iptm_traffic",
    VIEW,
)
ABSENT = {name for name in EXTRAS if find_spec(name) is None}
"""Extras that are not installed: what is made then lacks the lines of the committed pages on them."""
NOTICE = "<!-- Made by scripts/dev docs from the code; do not edit. -->\n\n"


def parameters_page() -> str:
    """Every model parameter of every set that is a file, with its unit, range and source."""
    sets = {
        name: [
            {**row, "source": ": ".join(filter(None, (row["source"], row["note"])))}
            for row in describe_parameters(load_parameters(name))
        ]
        for name in available_parameter_sets()
        if name not in cars()
    }
    return render_page(TEMPLATES, "parameters.md.j2", sets=sets)


def commands_page() -> str:
    """The programs in scripts/ with the first line of their help, and the commands of `iptm`."""
    scripts = []
    for path in sorted((DOCS.parent / "scripts").iterdir()):
        if path.is_file():
            text = path.read_text(encoding="utf-8")
            head = next(line for line in text.splitlines() if line.startswith("# "))
            summary = head.removeprefix("# ").partition(": usage:")[0].removesuffix(":")
            scripts.append({"name": path.name, "summary": summary})
    commands = [{"name": name, "summary": each.summary} for name, each in all_commands().items()]
    return render_page(TEMPLATES, "commands.md.j2", scripts=scripts, commands=commands)


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


def _specs(parameters: type[Any], no_unit: str = "-") -> list[dict[str, object]]:
    return [
        {"spec": spec, "default": plain(spec.default), "unit": spec.unit or no_unit}
        for spec in parameter_specs(parameters)
    ]


def nodes_page() -> str:
    """Parameters of the three nodes, of the sender of messages and of the visualizer."""
    nodes = {node: parameters for node, (parameters, _) in NODES.items()}
    if ITS not in ABSENT:
        nodes["v2x_sender"] = import_module(f"{ITS}.node_sender").SenderNodeParameters
    if VIEW not in ABSENT:
        node = import_module(f"{VIEW}.visualizer_node")
        nodes[node.PUBLISHER] = node.VisualizerParameters
    return render_page(
        TEMPLATES,
        "nodes.md.j2",
        nodes={name: _specs(parameters) for name, parameters in nodes.items()},
        controller=CONTROLLER,
        changeable=CHANGEABLE,
    )


def node_file(node: str) -> str:
    """The parameter file of a node: every default, with its meaning."""
    parameters, about = NODES[node]
    specs = parameter_specs(parameters)
    header = (
        f"# {about}\n# Made by scripts/dev docs from the code. These are the defaults; "
        "`ros2 param describe` and `--help`\n# of the node show the permitted ranges.\n"
    )
    return header + parameter_file_text(
        node,
        {spec.name: plain(spec.default) for spec in specs},
        {spec.name: spec.description + (f" [{spec.unit}]" if spec.unit else "") for spec in specs},
    )


def strategies_page() -> str:
    """The strategies and the solver outcomes."""
    strategies = [
        {
            "name": strategy.name,
            "weights": ", ".join(
                f"{COST_TERMS[key].symbol} = {weight:g}"
                for key, weight in strategy.weights.items()
                if weight
            ),
            "cost_to_go": "yes" if strategy.cost_to_go else "no",
        }
        for strategy in STRATEGIES.values()
        if not strategy.is_rule_based
    ]
    return render_page(
        TEMPLATES,
        "strategies.md.j2",
        default=DEFAULT_STRATEGY,
        strategies=strategies,
        laws=_specs(ProductionSettings, "1"),
        simple=SIMPLE,
        outcomes=[{"status": status, "meaning": text} for status, text in STATUS_TEXT.items()],
    )


def figures_page() -> str:
    """Every figure of a run that tables, pictures, files and the report show."""
    figures = [
        {
            "key": key,
            "label": figure.label,
            "symbol": figure.symbol or "-",
            "unit": figure.unit or "1",
            "better": figure.better,
            "definition": figure.definition,
        }
        for key, figure in {**SAVINGS, **FIGURES, WORTH.key: WORTH}.items()
    ]
    return render_page(TEMPLATES, "figures.md.j2", figures=figures)


def faults_page() -> str:
    """Every kind of fault, and the keys of one."""
    allowed = {"kind": "one of those below", "size": "see the kind"}
    defaults = {"size": "as in the kind", "target": "see the kind"}
    keys = [
        row
        | {
            "default": defaults.get(spec.name, f"`{row['default']}`"),
            "allowed": allowed.get(spec.name, spec.allowed).replace("one of , ", "one of "),
        }
        for row in _specs(Fault)
        for spec in (row["spec"],)
    ]
    kinds = []
    for kind in FaultKind:
        spec = kind.spec
        row = {"kind": kind, "place": spec.place.value, "meaning": spec.meaning}
        row |= {"size": "-", "allowed": "-", "headless": "yes" if spec.headless else "no"}
        if spec.has_size:
            row["size"] = f"{spec.size:g} {spec.unit}"
            row["allowed"] = f"{spec.smallest:g} to {spec.largest:g}"
        kinds.append(row)
    return render_page(TEMPLATES, "faults.md.j2", keys=keys, kinds=kinds)


PAGES = {
    DOCS / "reference" / "commands.md": commands_page,
    DOCS / "reference" / "faults.md": faults_page,
    DOCS / "reference" / "figures.md": figures_page,
    DOCS / "reference" / "library.md": partial(library_page, NOTICE),
    DOCS / "reference" / "services.md": services_page,
    DOCS / "reference" / "trip.schema.json": trip_schema,
    DOCS / "reference" / "vehicle.schema.json": vehicle_schema,
    DOCS / "reference" / "topics.md": topics_page,
    DOCS / "reference" / "parameters.md": parameters_page,
    DOCS / "reference" / "nodes.md": nodes_page,
    DOCS / "reference" / "strategies.md": strategies_page,
    **{CONFIG / f"{node}.yaml": partial(node_file, node) for node in NODES},
}
if METER not in ABSENT:
    PAGES[DOCS / "reference" / "cars.md"] = import_module("cars_reference").cars_page


def _agree(made: str, committed: str) -> bool:
    return set(made.splitlines()) <= set(committed.splitlines()) if ABSENT else made == committed


def main() -> int:
    """Write the pages, or with ``--check`` compare them with what is committed."""
    parser = argparse.ArgumentParser(description="Write docs/reference from the code.")
    parser.add_argument("--check", action="store_true", help="write nothing, fail when out of date")
    check = parser.parse_args().check
    if ABSENT and not check:
        print(f"not installed: {', '.join(sorted(ABSENT))}; allowed: all extras", file=sys.stderr)
        return 1
    stale = []
    for path, page in PAGES.items():
        text = page()
        if check:
            if not path.exists() or not _agree(text, path.read_text(encoding="utf-8")):
                stale.append(path.name)
        else:
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
    if stale:
        print(f"out of date: {', '.join(stale)}; run scripts/dev docs", file=sys.stderr)
    return 1 if stale else 0


if __name__ == "__main__":
    sys.exit(main())
