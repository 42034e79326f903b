"""The paper's numbers and statements, read strictly from ``paper_claims.yaml``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, get_type_hints

from iptm_core.errors import ScenarioError
from iptm_core.parameters import field_specs
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_studies.report.addresses import expanded_all
from iptm_studies.report.arguments import build, mapping
from iptm_studies.report.measures import MEASURES
from iptm_studies.report.paper import (
    Claim,
    Formulation,
    FormulationTable,
    Headline,
    PaperClaims,
    PaperFigure,
    PaperReference,
    ParameterTable,
    PrintedParameter,
    StrategyTable,
)
from iptm_studies.report.rules import RULES, Rule
from iptm_studies.report.runs import STUDIES
from iptm_studies.report.verdict import Tolerance

CLAIMS_FILE = Path(__file__).parent / "paper_claims.yaml"

_ADDRESS_FIELDS = {"run", "base", "runs", "lower", "higher", "ends", "among", "others", "reference"}
_MEASURE_FIELDS = {"measure", "measures", "directions"}


def load_claims(path: Path = CLAIMS_FILE) -> PaperClaims:
    """Read and check the file.

    Args:
        path: a file like the one of this package.

    Returns:
        Its content.

    Raises:
        ScenarioError: the file is missing or malformed, or names an unknown rule, argument, study,
            figure or parameter; the message names the place.
    """
    content = mapping(read_yaml(path, ScenarioError), path.name)
    # `lists` only holds YAML anchors, which are resolved by now.
    content.pop("lists", None)
    wanted = [entry.name for entry in fields(PaperClaims)]
    missing = [name for name in wanted if name not in content]
    unknown = [name for name in content if name not in wanted]
    if missing or unknown:
        raise ScenarioError(
            f"{path.name}: missing {missing}, unknown {unknown}; needed are {', '.join(wanted)}"
        )
    claims = _rows(content["claims"], f"{path.name}: claims")
    result = PaperClaims(
        paper=build(PaperReference, content["paper"], f"{path.name}: paper"),
        change_tolerance=build(
            Tolerance, content["change_tolerance"], f"{path.name}: change_tolerance"
        ),
        parameter_tables=tuple(
            _table(ParameterTable, PrintedParameter, entry, f"{path.name}: parameter_tables")
            for entry in _rows(content["parameter_tables"], f"{path.name}: parameter_tables")
        ),
        formulations=_table(
            FormulationTable, Formulation, content["formulations"], f"{path.name}: formulations"
        ),
        strategy_table=build(
            StrategyTable, content["strategy_table"], f"{path.name}: strategy_table"
        ),
        headline=build(Headline, content["headline"], f"{path.name}: headline"),
        figures=tuple(
            build(PaperFigure, entry, f"{path.name}: figures")
            for entry in _rows(content["figures"], f"{path.name}: figures")
        ),
        claims=tuple(_claim(entry, path.name) for entry in claims),
    )
    _check(result, path.name)
    return result


def _rows(value: object, origin: str) -> list[Any]:
    if not isinstance(value, list) or not value:
        raise ScenarioError(f"{origin}: a list with at least one entry is needed")
    return value


def _table(cls: Any, row_type: Any, value: object, origin: str) -> Any:
    """Build a table whose rows are dataclasses of their own."""
    entries = mapping(value, origin)
    rows = _rows(entries.pop("rows", None), f"{origin}: rows")
    built = tuple(
        build(row_type, row, f"{origin}: row {index}") for index, row in enumerate(rows, start=1)
    )
    texts = {name: str(entries.pop(name)) for name in ("table", "title") if name in entries}
    if entries or len(texts) < 2:
        raise ScenarioError(
            f"{origin}: needed are exactly table, title and rows, got also {sorted(entries)}"
        )
    return cls(rows=built, **texts)


def _claim(value: object, file: str) -> Claim:
    entries = mapping(value, f"{file}: claim")
    name = entries.pop("id", None)
    if not isinstance(name, str) or not name:
        raise ScenarioError(f"{file}: a claim without id: {value!r:.80}")
    origin = f"{file}: claim {name}"
    texts = {key: entries.pop(key, "") for key in ("group", "where", "statement", "note")}
    lacking = [key for key in ("group", "where", "statement") if not texts[key]]
    if lacking or not all(isinstance(text, str) for text in texts.values()):
        raise ScenarioError(f"{origin}: {', '.join(lacking) or 'text fields'} must be a text")
    rule_name = entries.pop("rule", None)
    if rule_name not in RULES:
        raise ScenarioError(f"{origin}: unknown rule {rule_name!r}; known: {', '.join(RULES)}")
    rule_type = RULES[rule_name]
    arguments = {key: _written_out(key, argument, origin) for key, argument in entries.items()}
    rule = build(rule_type, arguments, f"{origin}, rule {rule_name}")
    _check_rule(rule, origin)
    return Claim(name, rule=rule, **texts)


def _written_out(key: str, argument: object, origin: str) -> object:
    """Expand the shorthand of addresses in an argument."""
    if key in _ADDRESS_FIELDS and isinstance(argument, list):
        return list(expanded_all([str(part) for part in argument], f"{origin}: {key}"))
    if key in {"groups", "candidates"} and isinstance(argument, Mapping):
        return {
            name: _written_out("runs", part, f"{origin}: {key}") for name, part in argument.items()
        }
    return argument


def _check_rule(rule: Rule, origin: str) -> None:
    for address in rule.needs():
        if address.partition("/")[0] not in STUDIES:
            raise ScenarioError(
                f"{origin}: run '{address}' of an unknown study; known: {', '.join(STUDIES)}"
            )
    for name in _MEASURE_FIELDS & set(get_type_hints(type(rule))):
        value = getattr(rule, name)
        for key in [value] if isinstance(value, str) else value:
            if key not in MEASURES:
                raise ScenarioError(
                    f"{origin}: unknown figure '{key}'; known: {', '.join(MEASURES)}"
                )


def _check(claims: PaperClaims, file: str) -> None:
    """Refuse what only shows in the whole: equal ids, unknown parameters, ragged tables."""
    ids = [claim.id for claim in claims.claims]
    twice = sorted({name for name in ids if ids.count(name) > 1})
    if twice:
        raise ScenarioError(f"{file}: claims with the same id: {', '.join(twice)}")
    for table in claims.parameter_tables:
        for row in table.rows:
            if row.key not in field_specs():
                raise ScenarioError(f"{file}: {table.table}: unknown parameter '{row.key}'")
    results = claims.strategy_table
    for values, width in ((results.values, 0), (results.changes, 1)):
        for key, entries in values.items():
            if key not in MEASURES or len(entries) != len(results.order) - width:
                raise ScenarioError(
                    f"{file}: {results.table}: '{key}' is unknown or has {len(entries)} entries; "
                    f"needed are {len(results.order) - width}"
                )
    for key in claims.headline.changes:
        if key not in MEASURES:
            raise ScenarioError(f"{file}: headline: unknown figure '{key}'")
