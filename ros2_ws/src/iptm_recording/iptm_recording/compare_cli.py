"""The command `compare_bags`: did two runs do the same, and where did they first part?"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table

from iptm_core.errors import BagError
from iptm_recording.compare import (
    DEFAULT_EXCLUDED_TOPICS,
    DEFAULT_IGNORED_FIELDS,
    BagComparison,
    CompareOptions,
    TopicComparison,
    compare_bags,
)
from iptm_recording.field_differences import NumberTolerance
from iptm_recording.recorded_topics import TopicSelection

_PIPE_WIDTH = 140
_FIELDS_SHOWN = 8


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="compare_bags",
        description="Compare two bags topic by topic, bit for bit unless a tolerance is given."
        " Ends with 0 when they agree, 1 when they differ, 2 when one cannot be read.",
    )
    parser.add_argument("first", type=Path, help="reference: bag folder or .mcap file")
    parser.add_argument("second", type=Path, help="bag folder or .mcap file")
    parser.add_argument(
        "--topics", nargs="+", default=[], metavar="TOPIC", help="names or patterns to compare"
    )
    parser.add_argument(
        "--exclude",
        nargs="+",
        default=list(DEFAULT_EXCLUDED_TOPICS),
        metavar="TOPIC",
        help=f"names or patterns to leave out (default: {' '.join(DEFAULT_EXCLUDED_TOPICS)})",
    )
    parser.add_argument(
        "--ignore",
        nargs="+",
        default=list(DEFAULT_IGNORED_FIELDS),
        metavar="FIELD",
        help=f"fields that may differ (default: {' '.join(DEFAULT_IGNORED_FIELDS)})",
    )
    parser.add_argument("--absolute", type=float, default=0.0, help="absolute tolerance of numbers")
    parser.add_argument("--relative", type=float, default=0.0, help="relative tolerance of numbers")
    return parser


def render(comparison: BagComparison) -> Table:
    """Return the outcome as a table, one row per topic."""
    table = Table("topic", title="comparison", title_justify="left")
    for heading in ("first", "second", "differ", "only first", "only second"):
        table.add_column(heading, justify="right")
    table.add_column("outcome")
    for topic in comparison.topics:
        counts = (
            topic.first_count,
            topic.second_count,
            topic.differing,
            topic.only_first,
            topic.only_second,
        )
        outcome = "agree" if topic.agrees else topic.remark or "DIFFER"
        table.add_row(topic.topic, *map(str, counts), outcome)
    return table


def first_divergence_text(topic: TopicComparison) -> str:
    """Return where two runs first differ on a topic, and by how much, as lines of text."""
    divergence = topic.first_divergence
    if divergence is None:
        return ""
    lines = [f"{topic.topic} first differs {divergence.where}:"]
    for difference in divergence.fields[:_FIELDS_SHOWN]:
        worst = topic.largest.get(difference.path, 0.0)
        lines.append(
            f"  {difference.path}: {difference.first!r} and {difference.second!r}"
            f" (largest difference anywhere: {worst:.3g})"
        )
    hidden = len(divergence.fields) - _FIELDS_SHOWN
    if hidden > 0:
        lines.append(f"  and {hidden} more fields")
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare two bags.

    Returns:
        0 when they agree, 1 when they differ, 2 when one cannot be read.
    """
    parsed = build_parser().parse_args(arguments)
    options = CompareOptions(
        selection=TopicSelection(tuple(parsed.topics), tuple(parsed.exclude)),
        tolerance=NumberTolerance(parsed.absolute, parsed.relative),
        ignored_fields=tuple(parsed.ignore),
    )
    try:
        comparison = compare_bags(parsed.first, parsed.second, options)
    except BagError as error:
        print(f"compare_bags: {error}", file=sys.stderr)
        return 2
    console = Console(width=None if sys.stdout.isatty() else _PIPE_WIDTH)
    console.print(render(comparison))
    for topic in comparison.topics:
        text = first_divergence_text(topic)
        if text:
            console.print(text, highlight=False, markup=False)
    console.print("the bags agree" if comparison.agrees else "the bags differ")
    return 0 if comparison.agrees else 1


if __name__ == "__main__":
    sys.exit(main())
