"""The reasons for differences, read strictly from ``causes.yaml``, with their numbers filled in."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import jinja2

from iptm_core.errors import ScenarioError
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_studies.report.arguments import mapping
from iptm_studies.report.measures import MEASURES, Measure, change_text, relative_change
from iptm_studies.report.rules.base import Printed
from iptm_studies.report.runs import STUDIES, Results

CAUSES_FILE = Path(__file__).parent / "causes.yaml"


def load_causes(known: Collection[str], path: Path = CAUSES_FILE) -> dict[str, str]:
    """Read the file.

    Args:
        known: ids of the claims.
        path: a file like the one of this package.

    Returns:
        Text by claim id, its placeholders still open.

    Raises:
        ScenarioError: the file is missing or malformed, or names a claim that does not exist.
    """
    content = mapping(read_yaml(path, ScenarioError), path.name)
    for name, text in content.items():
        if name not in known:
            raise ScenarioError(f"{path.name}: there is no claim '{name}'")
        if not isinstance(text, str) or not text.strip():
            raise ScenarioError(f"{path.name}: {name}: a text is needed, got {text!r:.80}")
    return content


def filled_in(
    causes: Mapping[str, str], results: Results, printed: Printed, file: str = CAUSES_FILE.name
) -> dict[str, str]:
    """Put numbers of stored runs into the causes; a dash stands for a missing run.

    Raises:
        ScenarioError: a placeholder is malformed or names an unknown figure or study.
    """

    def value(run: str, key: str) -> str:
        return _measure(run, key).with_unit(results.measure(run, key))

    def change(run: str, base: str, key: str) -> str:
        _measure(run, key)
        _measure(base, key)
        return change_text(relative_change(results.measure(run, key), results.measure(base, key)))

    def in_print(run: str, key: str) -> str:
        return _measure(run, key).with_unit(printed.value(run, key))

    # The texts are part of this package and go through the page's own escaping afterwards.
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False)  # noqa: S701
    environment.globals.update(value=value, change=change, printed=in_print)
    return {name: _rendered(environment, text, f"{file}: {name}") for name, text in causes.items()}


def _rendered(environment: jinja2.Environment, text: str, origin: str) -> str:
    try:
        return environment.from_string(" ".join(text.split())).render()
    except (jinja2.TemplateError, TypeError, ScenarioError) as reason:
        raise ScenarioError(f"{origin}: {reason}") from reason


def _measure(run: str, key: str) -> Measure:
    if run.partition("/")[0] not in STUDIES:
        raise ScenarioError(f"run '{run}' of an unknown study; known: {', '.join(STUDIES)}")
    if key not in MEASURES:
        raise ScenarioError(f"unknown figure '{key}'; known: {', '.join(MEASURES)}")
    return MEASURES[key]
