"""What the paper prints, as data types; the content is read by `iptm_studies.report.claims`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from iptm_studies.report.rules.base import Printed, Rule
from iptm_studies.report.verdict import Tolerance


@dataclass(frozen=True)
class PaperReference:
    """What is reproduced."""

    title: str
    authors: str


@dataclass(frozen=True)
class PrintedParameter:
    """One printed parameter; ``key`` is this project's, the value is in ``unit``."""

    key: str
    printed: float
    unit: str


@dataclass(frozen=True)
class ParameterTable:
    """A printed table of parameters."""

    table: str
    title: str
    rows: tuple[PrintedParameter, ...]


@dataclass(frozen=True)
class Formulation:
    """A printed row of cost terms; ``terms`` are the numbers of J1 to J4."""

    strategy: str
    label: str
    terms: tuple[int, ...]


@dataclass(frozen=True)
class FormulationTable:
    """The printed table of formulations."""

    table: str
    title: str
    rows: tuple[Formulation, ...]

    def label(self, strategy: str) -> str:
        """The paper's name of a strategy; the project's own if the paper has none."""
        return next((row.label for row in self.rows if row.strategy == strategy), strategy)


@dataclass(frozen=True)
class StrategyTable:
    """The printed results table: values by figure and, from the second strategy on, changes."""

    table: str
    title: str
    order: tuple[str, ...]
    values: Mapping[str, tuple[float, ...]]
    changes: Mapping[str, tuple[float, ...]]
    note: str = ""


@dataclass(frozen=True)
class Headline:
    """The printed headline comparison."""

    where: str
    run: str
    base: str
    changes: Mapping[str, float]


@dataclass(frozen=True)
class PaperFigure:
    """A printed figure and the key of the one that stands for it here."""

    key: str
    figure: str
    caption: str


@dataclass(frozen=True)
class Claim:
    """A statement of the paper.

    Attributes:
        id: short name, key of its cause.
        group: heading it is listed under.
        where: where the paper says so.
        statement: what the paper says, in own words.
        rule: how it is checked.
        note: remark on how the statement is read; may be empty.
    """

    id: str
    group: str
    where: str
    statement: str
    rule: Rule
    note: str = ""


@dataclass(frozen=True)
class PaperClaims:
    """Everything that the paper prints and this project compares with."""

    paper: PaperReference
    change_tolerance: Tolerance
    parameter_tables: tuple[ParameterTable, ...]
    formulations: FormulationTable
    strategy_table: StrategyTable
    headline: Headline
    figures: tuple[PaperFigure, ...]
    claims: tuple[Claim, ...]

    @property
    def printed(self) -> Printed:
        """The printed numbers in the form that rules take."""
        table = self.strategy_table
        return Printed(
            {
                f"strategies/{strategy}": {key: row[index] for key, row in table.values.items()}
                for index, strategy in enumerate(table.order)
            },
            self.change_tolerance,
        )
