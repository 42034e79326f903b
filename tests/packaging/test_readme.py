"""Links lead somewhere, README names all commands and real messages, reference pages are current."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.packaging.packages import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
INSTALLATION = (ROOT / "docs" / "how-to" / "installation.md").read_text(encoding="utf-8")
STUDY = ROOT / "studies" / "road_space" / "README.md"
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


def test_the_savings_are_rows_of_their_study_with_both_bases() -> None:
    """A saving of a cycle stands beside the cars that it is compared with, with its headway and preview."""
    shown, made = savings(README), savings(STUDY.read_text(encoding="utf-8"))
    assert shown[0] == made[0]
    assert "headway" in shown[0]
    assert set(shown) <= set(made)
    for cycle in {row[0] for row in made[2:]}:
        controls = {row[1] for row in shown if row[0] == cycle}
        assert {"`production`", "`eco_acc`", "`default`"} <= controls, cycle


def savings(page: str) -> list[tuple[str, ...]]:
    """Return the rows of the table of savings, its heading first."""
    (table,) = re.findall(r"<!-- savings -->(.*)<!-- end of savings -->", page, re.DOTALL)
    return [tuple(map(str.strip, row.strip("|").split("|"))) for row in table.split("\n") if row]


def test_rosdep_skips_exactly_what_comes_with_pip() -> None:
    manifests = (ROOT / "ros2_ws" / "src").glob("*/package.xml")
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
        capture_output=True, text=True, timeout=120, check=False
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
