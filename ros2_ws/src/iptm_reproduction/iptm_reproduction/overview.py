"""Parts of the report on the report itself: what it rests on, how verdicts come about, how many there are."""

from __future__ import annotations

from iptm_reproduction.check import Verdict, tally
from iptm_reproduction.document import Block, Cell, Paragraph, Table, cells
from iptm_reproduction.parts import Material

RULES_TEXT = (
    "A statement is reproduced if the rule beside it holds within the stated tolerance; reproduced in "
    "sign only if the direction is right and the size is not; not reproduced otherwise; not tested if "
    "a run is missing. Rules are applied by code to stored runs. Where a rule can be applied to the "
    "paper's printed numbers alone, its outcome for them is given, too. The printed numbers and "
    "statements are data, each with its place in the paper."
)


def runs_used(material: Material) -> Block:
    """Say how many runs the page rests on, and of which trip."""
    origin = material.provenance
    return Paragraph(
        f"Every number on this page comes from {origin.runs} stored runs of the trip "
        f"{origin.trip} ({origin.cases} cases of the studies; equal runs are stored once)."
    )


def other_trip(material: Material) -> Block | None:
    """Warn that the runs drive another trip than the paper's, if so."""
    if material.provenance.whole_cycle:
        return None
    return Paragraph(
        "The runs do not all drive the whole comprehensive cycle. What is printed holds for "
        "that cycle, so that verdicts on numbers mean little here."
    )


def incomplete(material: Material) -> Block | None:
    """Say which runs are missing and how to compute them, if any are."""
    missing = material.results.missing
    if not missing:
        return None
    names = dict.fromkeys(run.study for run in missing)
    return Paragraph(
        f"This report is incomplete: {len(missing)} cases are missing, of the studies "
        f"{', '.join(names)}. What is not shown for this reason says so in its place. To "
        f"compute them: {material.gathered.command} {' '.join(names)}"
    )


def verdicts(material: Material) -> Block:
    """Return the number of statements by topic and verdict."""
    every = tuple(entry for entries in material.checked.values() for entry in entries)
    rows = [
        (
            Cell(title, strong=entries is every),
            Cell(str(len(entries))),
            *(Cell(str(count)) for count in tally(entries).values()),
        )
        for title, entries in (*material.checked.items(), ("all statements", every))
    ]
    return Table(
        "verdicts",
        "Statements of the paper by verdict",
        ("statements about", "number", *(verdict.value for verdict in Verdict)),
        tuple(rows),
    )


def origin_table(material: Material) -> Block:
    """Return the origin of the runs as a table."""
    origin = material.provenance
    return Table(
        "origin",
        "Origin of the runs",
        ("", ""),
        (
            cells("trip", origin.trip),
            cells("runs", f"{origin.runs} ({origin.cases} cases)"),
            cells("computed", f"{origin.first_utc} to {origin.last_utc}"),
            cells("wall time of all runs, one after the other", f"{origin.wall_h:.2f} h"),
            cells("runs without compiled problem", str(origin.interpreted)),
            cells("source", _counted(origin.revisions)),
            *(cells(name, _counted(versions)) for name, versions in origin.versions.items()),
        ),
    )


def _counted(values: dict[str, int]) -> str:
    if len(values) == 1:
        return next(iter(values))
    return ", ".join(f"{name} ({count} runs)" for name, count in values.items())
