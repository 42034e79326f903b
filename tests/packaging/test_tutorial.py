"""Figures in the prose of the documentation are those that the study of the tutorial makes."""

from __future__ import annotations

import re

import pytest
from studies.tutorial.run import COMMANDS
from tests.documented_commands import ROOT, documented_commands

STUDY = (ROOT / "studies" / "tutorial" / "README.md").read_text(encoding="utf-8")
_FIGURE = re.compile(r"(?<![\w.])\d+\.\d+(?= and | %| ppm)")
PAGES = ("docs/tutorial.md", "docs/explanation/comparison.md")


@pytest.mark.parametrize("page", PAGES)
def test_every_figure_with_a_point_is_in_the_page_of_the_study(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8").split("The summary names")[0]
    prose = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    figures = set(_FIGURE.findall(" ".join(prose.split())))
    assert figures
    assert figures <= set(re.findall(r"\d+\.\d+", STUDY))


def test_the_commands_of_the_study_are_those_of_the_tutorial() -> None:
    shown = {command for command, page in documented_commands().items()}
    assert set(COMMANDS) <= shown
