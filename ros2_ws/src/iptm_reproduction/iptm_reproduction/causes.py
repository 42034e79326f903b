"""Why results differ from the paper, and remarks on chapters: ``causes.yaml`` with stored numbers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2
import yaml

from iptm_reproduction import figures, runs
from iptm_reproduction.figure_texts import Numbers
from iptm_reproduction.printed_cooling import reproduced_cooling
from iptm_reproduction.runs import Results

CHILLER_PROPOSED = "omitted_parameters/published_chiller_35_degc/aging"
CHILLER_REFERENCE = "omitted_parameters/published_chiller_35_degc/reference"


def causes(results: Results) -> dict[str, str]:
    """Return the reason for each difference by claim id; shown unless the verdict is "reproduced"."""
    return {
        claim: entry["text"] for entry in _filled_in(results)["causes"] for claim in entry["claims"]
    }


def remarks(results: Results) -> dict[str, str]:
    """Return remarks by chapter key; shown at the beginning of the chapter, always."""
    return dict(_filled_in(results)["remarks"])


def _filled_in(results: Results) -> Any:
    numbers = Numbers(results)
    # The texts are data of this package and end in Markdown, which is not HTML.
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined)  # noqa: S701
    environment.globals.update(
        {
            name: value
            for module in (figures, runs)
            for name, value in vars(module).items()
            if name.isupper()
        },
        CHILLER_PROPOSED=CHILLER_PROPOSED,
        CHILLER_REFERENCE=CHILLER_REFERENCE,
        printed_cooling=reproduced_cooling(),
        value=numbers.value,
        printed=numbers.printed,
        change=numbers.change,
        payback=numbers.payback,
        braking_share=numbers.braking_share,
    )

    def rendered(entry: Any) -> Any:
        if isinstance(entry, dict):
            return {key: rendered(value) for key, value in entry.items()}
        if isinstance(entry, list):
            return [rendered(value) for value in entry]
        return environment.from_string(entry).render()

    source = Path(__file__).with_name("causes.yaml").read_text(encoding="utf-8")
    return rendered(yaml.safe_load(source))
