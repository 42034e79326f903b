"""The reasons for differences, read strictly from ``causes.yaml``, with their numbers filled in."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

import jinja2

from iptm_core.errors import ScenarioError
from iptm_core.metrics import Figure
from iptm_core.parameters.strict_yaml import read_yaml
from iptm_studies.report.arguments import mapping
from iptm_studies.report.measures import MEASURES, change_text, relative_change
from iptm_studies.report.payback import cooling_payback
from iptm_studies.report.quantities import share_while_braking
from iptm_studies.report.rules.base import Printed
from iptm_studies.report.runs import STUDIES, ReportRun, Results

CAUSES_FILE = Path(__file__).parent / "causes.yaml"


_PERCENTILES = (10.0, 90.0)


@dataclass(frozen=True)
class Causes:
    """Texts with open placeholders.

    Attributes:
        claims: reasons for differences by claim id.
        chapters: remarks by chapter key.
    """

    claims: Mapping[str, str]
    chapters: Mapping[str, str]


def load_causes(claim_ids: Collection[str], path: Path = CAUSES_FILE) -> Causes:
    """Read the file.

    Args:
        claim_ids: ids of the claims.
        path: a file like the one of this package.

    Returns:
        Its texts.

    Raises:
        ScenarioError: the file is missing or malformed, or names a claim that does not exist.
    """
    content = mapping(read_yaml(path, ScenarioError), path.name)
    if set(content) != {"claims", "chapters"}:
        raise ScenarioError(f"{path.name}: has {sorted(content)}; needed are claims and chapters")
    texts = {name: mapping(part, f"{path.name}: {name}") for name, part in content.items()}
    for name, part in texts.items():
        for key, text in part.items():
            if not isinstance(text, str) or not text.strip():
                raise ScenarioError(
                    f"{path.name}: {name}: {key}: a text is needed, got {text!r:.80}"
                )
    for claim_id in texts["claims"]:
        if claim_id not in claim_ids:
            raise ScenarioError(f"{path.name}: there is no claim '{claim_id}'")
    return Causes(texts["claims"], texts["chapters"])


def filled_in(
    texts: Mapping[str, str], results: Results, printed: Printed, file: str = CAUSES_FILE.name
) -> dict[str, str]:
    """Put numbers of stored runs into texts; a dash stands for a missing run.

    Args:
        texts: by any key.
        results: the runs.
        printed: the printed numbers.
        file: what to call the origin in errors.

    Returns:
        The texts by the same keys.

    Raises:
        ScenarioError: a placeholder is malformed or names an unknown figure or study.
    """
    # The texts are part of this package and go through the page's own escaping afterwards.
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False)  # noqa: S701
    environment.globals.update(_placeholders(results, printed))
    return {name: _rendered(environment, text, f"{file}: {name}") for name, text in texts.items()}


def _placeholders(results: Results, printed: Printed) -> dict[str, Callable[..., str]]:
    def value(run: str, key: str) -> str:
        return _measure(run, key).with_unit(results.measure(run, key))

    def change(run: str, base: str, key: str) -> str:
        _measure(run, key)
        _measure(base, key)
        return change_text(relative_change(results.measure(run, key), results.measure(base, key)))

    def in_print(run: str, key: str) -> str:
        return _measure(run, key).with_unit(printed.value(run, key))

    def payback(run: str) -> str:
        record = _run(run, results)
        found = None if record is None else cooling_payback(record, _PERCENTILES)
        if found is None:
            return "– s"
        times = found.times_s.values()
        return f"{min(times):.0f} to {max(times):.0f} s"

    def braking_share(run: str) -> str:
        record = _run(run, results)
        share = None if record is None else share_while_braking(record.trajectory)
        return "– %" if share is None else f"{100.0 * share:.1f} %"

    return {
        "value": value,
        "change": change,
        "printed": in_print,
        "payback": payback,
        "braking_share": braking_share,
    }


def _rendered(environment: jinja2.Environment, text: str, origin: str) -> str:
    try:
        return environment.from_string(" ".join(text.split())).render()
    except (jinja2.TemplateError, TypeError, ScenarioError) as reason:
        raise ScenarioError(f"{origin}: {reason}") from reason


def _run(address: str, results: Results) -> ReportRun | None:
    _check_study(address)
    return results.get(address)


def _check_study(address: str) -> None:
    if address.partition("/")[0] not in STUDIES:
        raise ScenarioError(f"run '{address}' of an unknown study; known: {', '.join(STUDIES)}")


def _measure(run: str, key: str) -> Figure:
    _check_study(run)
    if key not in MEASURES:
        raise ScenarioError(f"unknown figure '{key}'; known: {', '.join(MEASURES)}")
    return MEASURES[key]
