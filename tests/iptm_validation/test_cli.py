"""The command on the excerpts: every bar is met, the page is written, mistakes are one line."""

from pathlib import Path

import pytest

from iptm_validation import fitting
from iptm_validation.cli import main
from iptm_validation.fitting import load_parameters, package_folder, save_parameters
from iptm_validation.measurements import MeasuredData


@pytest.fixture
def output_width(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "220")
    monkeypatch.delenv("IPTM_MEASURED_DATA", raising=False)


@pytest.mark.usefixtures("output_width")
def test_models_meet_their_bars_on_the_excerpts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--page", str(tmp_path)]) == 0
    table = capsys.readouterr().out
    assert "MISSED" not in table
    for name in ("energy from torque, total", "pack voltage", "case temperature", "kept at 10 s"):
        assert name in table
    assert "A03: for a minute" in table, "a trip with unrecorded heating is reported apart"
    page = (tmp_path / "validation.md").read_text(encoding="utf-8")
    assert page.count("| met |") > 25
    pictures = sorted(path.name for path in (tmp_path / "validation").iterdir())
    assert len(pictures) == 9
    for name in pictures:
        assert f"(validation/{name})" in page


@pytest.mark.usefixtures("output_width")
def test_mistakes_are_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["--data", str(tmp_path / "nowhere")]) == 2
    assert "nowhere" in capsys.readouterr().err
    (tmp_path / "notes.csv").write_text("a,b\n1,2\n", encoding="utf-8")
    monkeypatch.setenv("IPTM_MEASURED_DATA", str(tmp_path))
    assert main([]) == 2
    assert "nothing in these data" in " ".join(capsys.readouterr().err.split())
    assert main(["--parameters", str(tmp_path)]) == 2
    assert "bmw_i3_drivetrain.yaml" in capsys.readouterr().err
    assert main(["--fit", str(tmp_path), "--parameters", str(tmp_path / "new")]) == 2
    assert "no data to fit to" in capsys.readouterr().err


def test_parameters_survive_a_file(tmp_path: Path) -> None:
    fitted = fitting.load_fitted()
    for kind, value in fitted.items():
        path = tmp_path / f"{kind.__name__}.yaml"
        save_parameters(path, value, "test")
        assert load_parameters(path, kind) == value


def test_shipped_parameters_name_their_source_and_their_data() -> None:
    for path in package_folder().glob("*.yaml"):
        text = path.read_text(encoding="utf-8")
        assert "fitted to" in " ".join(text.split())
        assert "fitted_on" in text


def test_without_data_there_is_no_outcome() -> None:
    reports: list[str] = []
    assert list(fitting.compare_all(MeasuredData(), fitting.load_fitted(), reports.append)) == []
