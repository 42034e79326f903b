"""Links lead somewhere, README names all commands and real messages, reference pages are current."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.packaging.packages import FOLDERS, ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
INSTALLATION = (ROOT / "docs" / "how-to" / "installation.md").read_text(encoding="utf-8")
MOST_LINES = 120


PAGES = [*ROOT.glob("*.md"), *sorted((ROOT / "docs").rglob("*.md"))]


def anchors(page: Path) -> set[str]:
    """The anchors of the headings of a page, as GitHub makes them."""
    text = re.sub(
        r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    titles = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_and_links_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    if page.name != "CHANGELOG.md":
        for command in set(re.findall(r"(?<![\w/])scripts/([\w.]+\w)", text)):
            assert (ROOT / "scripts" / command).is_file(), f"no scripts/{command}"
    for target, _, anchor in re.findall(r"\]\((?!https?:)([^)#\s]*)(#([^)]+))?\)", text):
        file = (page.parent / target).resolve() if target else page
        assert file.exists(), f"broken link to {target}"
        if anchor:
            assert anchor in anchors(file), f"{target} has no heading #{anchor}"


def test_the_readme_is_short() -> None:
    assert README.count("\n") <= MOST_LINES


PARTS = re.compile(r"<!-- (\w+) -->\n(.*?)<!-- end of \1 -->", re.DOTALL)


def test_figures_are_those_of_the_pages_that_a_command_made() -> None:
    """A part between marks matches the page of the study by that name, and no saving stands elsewhere."""
    shown = dict(PARTS.findall(README))
    assert {"road_space", "life"} <= set(shown)
    for study, text in shown.items():
        page = (ROOT / "studies" / study / "README.md").read_text(encoding="utf-8")
        assert dict(PARTS.findall(page))[study] == text
        assert f"](studies/{study}/README.md)" in README
    assert re.findall(r"\d ?%", PARTS.sub("", README)) == []


def test_a_saving_is_stated_in_one_way_after_what_the_suite_is() -> None:
    """Energy first, then the median and range of cells beside the paper's law, and the distance kept."""
    head, _, *rows = (
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in dict(PARTS.findall(README))["road_space"].splitlines()
        if line.startswith("|")
    )
    columns = (
        "preview",
        "energy saved, equal ends (as driven)",
        "ageing saved, median of cells (range)",
        "by the paper's law",
        "headway, mean / median",
        "below s_min, longest, deepest",
    )
    places = [head.index(column) for column in columns]
    assert places == sorted(places)
    assert len(rows) <= 6
    for row in rows:
        energy, driven = map(float, re.findall(r"-?[\d.]+", row[places[1]]))
        median, lowest, highest = map(float, re.findall(r"-?[\d.]+", row[places[2]]))
        assert lowest <= median <= highest
        assert -100.0 < min(energy, driven) <= max(energy, driven) < 100.0
    assert README.index("## What it is") < README.index("## What it saves")
    assert "saves" not in README[: README.index("## What it is")]


def test_rosdep_skips_exactly_what_comes_with_pip() -> None:
    manifests = (folder / "package.xml" for folder in FOLDERS.values())
    keys = {
        key
        for manifest in manifests
        for key in re.findall(r"<exec_depend>([\w-]+-pip)<", manifest.read_text(encoding="utf-8"))
    }
    skipped = re.search(r'--skip-keys "([^"]+)"', INSTALLATION)
    assert skipped is not None
    assert skipped[1].split() == sorted(keys)


def test_messages_of_the_troubleshooting_table_are_real() -> None:
    printed = " ".join(
        (ROOT / "scripts" / name).read_text(encoding="utf-8") for name in ("setup", "env.sh")
    )
    for message in (
        "found no ",
        "lacks the venv module (ensurepip)",
        "comes as wheels for Linux on x86-64 only",
        "the Python package index could not be reached",
        "is not the one in the lock",
        ".venv was made for a sourced ROS 2 Jazzy, but none is sourced",
        "another set-up of this folder is running",
        "cannot fetch a C compiler",
    ):
        assert message in printed, message
        assert message in INSTALLATION, message


def test_reference_pages_are_up_to_date() -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "generate_reference.py"), "--check"],
        capture_output=True, text=True, timeout=300, check=False
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
