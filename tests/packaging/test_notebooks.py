"""The notebooks of the documentation run, and the outputs that they are stored with are those of the code.

``python -m tests.packaging.test_notebooks [FILE ...]`` runs them and stores their outputs.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient
from tests.packaging.packages import ROOT

NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
TIMEOUT_S = 900
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}
KINDS = {"text/plain", "text/html", "image/png"}
NUMBER = re.compile(r"[-+]?\d+\.?\d*(?:e[-+]?\d+)?")


def read(path: Path) -> Any:
    return nbformat.read(path, as_version=4)


def executed(path: Path, folder: Path) -> Any:
    """Run a notebook from its code alone, and leave out what differs from machine to machine."""
    notebook = read(path)
    resources = {"metadata": {"path": str(folder)}}
    NotebookClient(
        notebook, timeout=TIMEOUT_S, startup_timeout=TIMEOUT_S, kernel_name="python3",
        resources=resources, record_timing=False,
    ).execute()  # fmt: skip
    notebook.metadata = nbformat.from_dict(METADATA)
    for cell in code_cells(notebook):
        # Progress is written to the standard error.
        cell.outputs = [each for each in cell.outputs if each.get("name") != "stderr"]
        for data in (each["data"] for each in cell.outputs if "data" in each):
            if "image/png" in data:
                data.pop("text/plain", None)
    return notebook


def code_cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def texts(notebook: Any) -> Iterator[str]:
    for cell in code_cells(notebook):
        for output in cell.outputs:
            yield output.get("text") or output["data"].get("text/plain", "")


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_with_its_outputs(path: Path) -> None:
    notebook = read(path)
    assert notebook.metadata == METADATA
    assert [cell.execution_count for cell in code_cells(notebook)] == [
        place + 1 for place in range(len(code_cells(notebook)))
    ]
    outputs = [output for cell in code_cells(notebook) for output in cell.outputs]
    shown = set().union(*(output["data"] for output in outputs if "data" in output))
    assert shown == KINDS
    assert not any(output.output_type == "error" for output in outputs)
    assert str(ROOT) not in path.read_text(encoding="utf-8")


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_outputs_are_those_of_the_code(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The kernel is of this environment, wherever Jupyter of the user's looks for others.
    monkeypatch.setenv("JUPYTER_PATH", str(Path(sys.prefix, "share", "jupyter")))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    stored, found = list(texts(read(path))), list(texts(executed(path, tmp_path)))
    assert len(found) == len(stored)
    for text, expected in zip(found, stored, strict=True):
        assert NUMBER.sub("", text).split() == NUMBER.sub("", expected).split()
        numbers, wanted = ([float(each) for each in NUMBER.findall(t)] for t in (text, expected))
        assert numbers == pytest.approx(wanted, rel=1e-3, abs=2e-3)


def main() -> None:
    """Run the notebooks and store them with their outputs."""
    for path in [Path(each) for each in sys.argv[1:]] or NOTEBOOKS:
        with TemporaryDirectory() as folder:
            nbformat.write(executed(path, Path(folder)), path)


if __name__ == "__main__":
    main()
