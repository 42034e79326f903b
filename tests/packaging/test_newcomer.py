"""From a question to an answer, by the commands of docs/how-to/your-commute.md, with a drive of one's own."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
from tests.packaging.packages import ROOT

PAGE = ROOT / "docs" / "how-to" / "your-commute.md"
MOST_COMMANDS = 5


def written(path: Path, duration_s: int) -> None:
    """Write a drive as a logger does: stops, two speeds, hills."""
    rows = ["Time,Speed (km/h),Altitude (m)"]
    for time_s in range(duration_s + 1):
        phase_s = time_s % 150
        rise, fall = 4.0 * (phase_s - 12), 3.0 * (145 - phase_s)
        speed = max(min(rise, fall, 50.0 if phase_s < 60 else 74.0), 0.0)
        rows.append(f"{time_s},{speed:.1f},{100.0 + 20.0 * math.sin(time_s / 150.0):.1f}")
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def test_it_takes_five_commands_at_most_and_a_wrong_name_is_one_line(tmp_path: Path) -> None:
    assert len(commands().splitlines()) <= MOST_COMMANDS
    drive = tmp_path / "my_commute.csv"
    written(drive, 90)
    script = ROOT / "docs" / "examples" / "commute.py"
    done = subprocess.run(
        [sys.executable, script, drive, "volkswagen_id5", "-5"],
        capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert "did you mean 'volkswagen_id4'?" in done.stderr


def commands() -> str:
    block = re.search(r"^```bash\n(.*?)^```", PAGE.read_text("utf-8"), re.DOTALL | re.MULTILINE)
    assert block is not None
    return block[1]


@pytest.mark.slow
@pytest.mark.parametrize("duration_s", [90, 900])
def test_a_question_has_an_answer_by_the_commands_of_the_page(
    duration_s: int, tmp_path: Path
) -> None:
    drive = tmp_path / "my_commute.csv"
    written(drive, duration_s)
    script = "set -e\n" + commands().replace("my_commute.csv", str(drive))
    done = subprocess.run(
        ["bash", "-c", script], cwd=ROOT, capture_output=True, text=True, timeout=1800, check=False
    )
    assert done.returncode == 0, done.stderr
    assert re.search(r"^energy: -?\d+\.\d % (saved|lost) \(±", done.stdout, re.MULTILINE)
    assert re.search(r"^ageing, \d cells: \d", done.stdout, re.MULTILINE)
    assert "% of the capacity lost after 8 years" in done.stdout
    assert "too short" not in done.stdout
