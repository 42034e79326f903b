"""The web pages are made without a warning; every link and anchor leads somewhere."""

import subprocess
import sys
from pathlib import Path

import pytest
from tests.packaging.packages import ROOT

pytest.importorskip("mkdocs", reason="requirements/docs.txt is not installed")


def test_the_site_is_made_of_the_pages_of_the_repository(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, ROOT / "docs" / "web_site.py", tmp_path / "site"],
        capture_output=True, text=True, timeout=300, check=False
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    for page in ("index", "docs/tutorial", "docs/reference/commands", "studies/paper/index"):
        assert (tmp_path / "site" / f"{page}.html").is_file(), page
