"""Every study: its short form runs, and its pages are those that its record describes."""

from __future__ import annotations

import ast
import shutil
import sys
from itertools import islice
from pathlib import Path

import pytest
from studies.__main__ import NAMES, main
from studies.embedded import run as embedded
from studies.embedded import safeguards
from studies.embedded.run import TOOLS
from studies.pages import (
    PAGE,
    SHOWN_DIGITS,
    STUDIES,
    Record,
    code_of,
    digest_of,
    files_and_packages,
    numbers_of,
    without_foot,
)
from studies.running import changes, module_of

from iptm import fingerprint
from iptm_core.user_input import shown

PACKAGES = {"iptm", "iptm_core", "iptm_controller", "iptm_plant_sim", "iptm_v2x_bridge", "studies"}
FROM_OUTSIDE = {"numpy", "pandas", "matplotlib", "jinja2", "yaml"}
MORE = {
    "benchmark/entrants.py": {"iptm_gym", "scipy"},
    "benchmark/foreign.py": {"iptm_ecu", "iptm_fmi"},
    # Bags are recorded for its table.
    "benchmark/kinds.py": {"iptm_ros"},
    "embedded": {"iptm_ecu"},
    # Trials over ROS 2 are read as messages.
    "trial.py": {"iptm_ros"},
    "traffic": {"iptm_traffic"},
    "chain": {"iptm_its", "iptm_traffic"},
    "v2x/prediction.py": {"iptm_traffic"},
    "validation": {"scipy"},
    "validation/drivers.py": {"iptm_drives"},
    "gateway": {"iptm_vehicle_interface"},
    "vehicle": {"iptm_vehicle_interface"},
    "headway/behind.py": {"iptm_string"},
    "string": {"iptm_string"},
    "judges": {"iptm_life"},
    "life": {"iptm_life"},
    "cabin": {"iptm_cabin"},
    "plan": {"iptm_judges", "iptm_life", "iptm_plan"},
    # They load real nodes and listen to them.
    "v2x/load.py": {
        "iptm_its",
        "iptm_ros",
        "rclpy",
        "sensor_msgs",
        "rosgraph_msgs",
    },
    "speed/peers.py": {"casadi"},
    "speed/transcription.py": {"casadi"},
}
"""What single studies need beyond that: extras, ROS 2, and CasADi where solvers are compared."""


@pytest.mark.parametrize("name", NAMES)
def test_the_short_form_has_the_numbers_of_the_record(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise the code has changed what the page says: it has to be made anew.

    ``scripts/study NAME --page`` makes it.
    """
    if name == "traffic":
        pytest.importorskip("traci")
    if name in {"gateway", "vehicle"}:
        pytest.importorskip("cantools")
    if name in {"judges", "plan"}:
        pytest.importorskip("blast")
    if name == "gateway":
        pytest.importorskip("opendbc")
    if name == "embedded":
        if any(shutil.which(tool) is None for tool in TOOLS):
            pytest.skip(f"needs {', '.join(TOOLS)}")
        # Two of five builds, and a tenth of the mutants, whose share is judged.
        monkeypatch.setattr(embedded, "BUILDS", (embedded.BUILDS[0], embedded.BUILDS[-1]))
        few = safeguards.mutants
        monkeypatch.setattr(safeguards, "mutants", lambda *given: islice(few(*given), 0, None, 10))
    record = Record.of(name)
    if getattr(module_of(name), "MEASURES_TIME", False):
        assert not record.short
        # `scripts/study confirm` notes it in the foot of the page, or the page is made anew.
        assert record.code == code_of(name) or record.out_of_date
        # One process: it builds each solver once.
        assert main([name, "--short", "--no-cache", "--quiet", "--workers", "1"]) == 0
    else:
        assert record.short
        # A page may be out of date only if it says so itself, and has reason to.
        assert bool(changes(name)) == bool(record.out_of_date)


@pytest.mark.parametrize("name", NAMES)
def test_committed_numbers_are_those_of_the_committed_page(name: str) -> None:
    record = Record.of(name)
    assert PAGE in record.pages
    warning = f"**Out of date:** {record.out_of_date}." if record.out_of_date else ""
    for page, digest in record.pages.items():
        text = (STUDIES / name / page).read_text("utf-8")
        assert digest_of(text) == digest
        foot = text.removeprefix(without_foot(text).rstrip("\n"))
        assert f"`scripts/study {name}`" in foot
        for part in (warning, record.made, record.confirmed, record.code[:SHOWN_DIGITS]):
            assert part in foot


def test_a_changed_number_or_line_of_code_is_noticed() -> None:
    page = (STUDIES / "acc" / PAGE).read_text("utf-8")
    number = numbers_of(page).split()[-1]
    place = without_foot(page).rindex(number)
    assert digest_of(page[:place] + "123456" + page[place + len(number) :]) != digest_of(page)
    assert digest_of(page.replace("confirmed", "made")) == digest_of(page)
    source = STUDIES / "acc" / "added_by_a_test.py"
    before = code_of("acc")
    try:
        source.write_text('"""A comment is no code."""\nVALUE = 1\n')
        first = code_of("acc")
        source.write_text("# Another one.\nVALUE = 1\n")
        assert code_of("acc") == first != before
    finally:
        source.unlink()


def test_what_a_study_imports_counts() -> None:
    """Modules and measurements of other studies, through others, too, and packages of the suite."""
    files, packages = files_and_packages("road_space")
    assert {STUDIES / "acc" / "scenes.py", STUDIES / "savings.py"} <= files
    assert STUDIES / "validation" / "data" / "openacc_5hz.csv.gz" in files
    assert STUDIES / "life" / "run.py" not in files
    assert "iptm_traffic" not in packages
    assert {"iptm_its", "iptm_traffic"} <= {*files_and_packages("traffic")[1]}


def test_what_a_study_imports_is_part_of_the_keys_of_its_calls(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    counted: list[object] = []
    for name in ("fingerprint", "fingerprint_of_files"):
        monkeypatch.setattr(fingerprint, name, lambda parts: counted.extend(parts) or "")
    fingerprint.code_of_package.__wrapped__("studies.chain")
    own = STUDIES / "chain"
    assert {own / "run.py", "iptm_its", STUDIES / "collisions" / "families.py"} <= {*counted}
    assert own / fingerprint.RECORD not in counted


@pytest.mark.parametrize("path", sorted(STUDIES.rglob("*.py")), ids=lambda path: path.name)
def test_studies_stand_on_the_library(path: Path) -> None:
    """They import the packages of a trip without ROS; the others are listed."""
    inside = path.relative_to(STUDIES).as_posix()
    allowed = PACKAGES | FROM_OUTSIDE | set(sys.stdlib_module_names)
    for place, more in MORE.items():
        allowed |= more if inside.startswith(place) else set()
    roots = {
        name.split(".")[0]
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert roots <= allowed, shown(roots - allowed)


def test_the_command_refuses_what_it_does_not_know(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["confirm", "nothing"]) == 2
    assert "allowed: acc" in capsys.readouterr().err
    assert main(["acc", "--short", "--page"]) == 2
