"""Writes docs/reference/*.md and the README's topic table from the code: no table is kept by hand.

Run it through ``scripts/update_docs``; a test fails when the committed pages are out of date.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from iptm_controller.node_parameters import ControllerNodeParameters
from iptm_controller.solvers.interface import STATUS_TEXT
from iptm_controller.strategy import STRATEGIES
from iptm_core.parameters import available_parameter_sets, describe_parameters, load_parameters
from iptm_interfaces.parameters import parameter_specs, parameter_table_markdown
from iptm_interfaces.topics import topic_table_markdown
from iptm_plant_sim.node_parameters import PlantNodeParameters
from iptm_v2x_bridge.node import BridgeParameters

DOCS = Path(__file__).resolve().parent
README = DOCS.parent / "README.md"
TABLE_START = "<!-- topics: made by scripts/update_docs from the code; do not edit. -->"
TABLE_END = "<!-- end of topics -->"
NOTICE = "<!-- Made by scripts/update_docs from the code; do not edit. -->\n\n"


def topics_page() -> str:
    """Every topic with type, QoS, unit and sign."""
    return (
        f"# Topics\n\n{NOTICE}Names are relative, so that a namespace moves the whole suite; only "
        "`/clock` and `/diagnostics` are global. All types are standard ones.\n\n"
        + topic_table_markdown()
    )


def parameters_page() -> str:
    """Every model parameter of every shipped set with its unit, range and source."""
    parts = [f"# Model parameters\n\n{NOTICE}"]
    for name in available_parameter_sets():
        parts.append(f"## `{name}`\n\n")
        parts.append(
            "| key | symbol | value | unit | range | source |\n|---|---|---|---|---|---|\n"
        )
        parts += [
            f"| `{row.key}` | {row.symbol} | {row.value:.10g} | {row.unit} "
            f"| {row.minimum:g} to {row.maximum:g} | {row.source}{f': {row.note}' if row.note else ''} |\n"
            for row in describe_parameters(load_parameters(name))
        ]
        parts.append("\n")
    return "".join(parts)


def nodes_page() -> str:
    """Parameters of the three nodes."""
    parts = [f"# Node parameters\n\n{NOTICE}"]
    for title, description in (
        ("plant", PlantNodeParameters),
        ("v2x_bridge", BridgeParameters),
        ("controller", ControllerNodeParameters),
    ):
        parts.append(f"## `{title}`\n\n{parameter_table_markdown(parameter_specs(description))}\n")
    return "".join(parts)


def strategies_page() -> str:
    """The six strategies and the solver outcomes."""
    rows = [
        f"| `{s.name}` | {s.speed_weight:g} | {s.temperature_weight:g} | {s.energy_weight_1_j:g} "
        f"| {s.aging_weight:g} |\n"
        for s in STRATEGIES.values()
    ]
    outcomes = [
        f"| {status.value} | {status.name} | {text} |\n" for status, text in STATUS_TEXT.items()
    ]
    return (
        f"# Strategies and outcomes\n\n{NOTICE}Weights of the cost terms; zero leaves a term out.\n\n"
        "| strategy | Q of J1, 1/(m/s)^2 | R of J2, 1/K^2 | lambda_P of J3, 1/J | lambda_Q of J4 |\n"
        "|---|---|---|---|---|\n" + "".join(rows) + "\n## Outcomes of a solve\n\n"
        "| code | status | meaning |\n|---|---|---|\n" + "".join(outcomes)
    )


def readme_page() -> str:
    """The README with its topic table as it should be."""
    text = README.read_text(encoding="utf-8")
    head, _, rest = text.partition(TABLE_START)
    _, _, tail = rest.partition(TABLE_END)
    return f"{head}{TABLE_START}\n{topic_table_markdown()}{TABLE_END}{tail}"


PAGES = {
    README: readme_page,
    DOCS / "reference" / "topics.md": topics_page,
    DOCS / "reference" / "parameters.md": parameters_page,
    DOCS / "reference" / "nodes.md": nodes_page,
    DOCS / "reference" / "strategies.md": strategies_page,
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
