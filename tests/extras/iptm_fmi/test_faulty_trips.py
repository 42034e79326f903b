"""Trips in which something goes wrong: each shows it in one message, and none in a traceback."""

from __future__ import annotations

import random
import re
import shutil
from pathlib import Path

import pytest
from tests.extras.iptm_fmi.faulty_trips import drive

import iptm
from iptm_core.errors import IptmError
from iptm_fmi import foreign_unit

pytest.importorskip("fmpy", reason="FMPy is not installed (requirements/fmi.txt)")
builder = pytest.importorskip(
    "pythonfmu.builder", reason="pythonfmu is not installed (requirements/fmi.txt)"
)
HERE = Path(__file__).parent
MAPPING = (HERE / "foreign_car.yaml").read_text("utf-8")
WAYS = {
    "t_pack is nan": "        self.t_pack = float('nan') if self.s > 1.0 else self.t_pack\n",
    "s is inf": "        self.s = float('inf') if self.s > 1.0 else self.s\n",
    "speed_m_s is": "        self.v_kmh = 1e5 if self.s > 1.0 else self.v_kmh\n",
    "not answered": "        __import__('time').sleep(1.0 if self.s > 1.0 else 0.0)\n",
    "fmi2DoStep failed": "        if self.s > 1.0:\n            raise RuntimeError('broken')\n",
    r"\(discard\)": "        if self.s > 1.0:\n            return False\n",
}
"""What a foreign car does wrong on its way, by what the message has to have."""
DAMAGED = r"damaged\.(yaml|fmu)|mapped|mapping"


@pytest.mark.parametrize(
    "seeds",
    [range(90), pytest.param(range(100, 1000), marks=pytest.mark.slow)],
    ids=["90", "900"],
)
def test_wrong_calls_are_refused_with_a_message_and_change_nothing(
    controllers: Path, seeds: range, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = []
    for seed in seeds:
        what, refused, same = drive(controllers, seed)
        message = capsys.readouterr().out.strip()
        if not (refused and same and message):
            wrong.append((seed, what, refused, same, message))
    assert wrong == []


@pytest.fixture(scope="module")
def ill_cars(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Foreign cars that go wrong, by the way they do."""
    well, found = (HERE / "foreign_car.py").read_text("utf-8"), {}
    for way, line in {"": "", **WAYS}.items():
        folder = tmp_path_factory.mktemp("ill")
        source = folder / f"car_{folder.name}.py"  # a module of Python in this process
        source.write_text(
            well.replace("        return True", f"{line}        return True"), "utf-8"
        )
        found[way] = Path(builder.FmuBuilder.build_FMU(str(source), dest=str(folder)))
        found[way].with_suffix(".yaml").write_text(MAPPING, "utf-8")
    return found


def damage(car: Path, folder: Path, chance: random.Random) -> Path:
    """Return a copy of a foreign car whose mapping or archive is damaged."""
    path = folder / "damaged.fmu"
    shutil.copy(car, path)
    lines = MAPPING.splitlines()
    rows = [at for at, line in enumerate(lines) if "{" in line]
    at, way = chance.choice(rows), chance.choice(("unit", "name", "key", "cut", "nan", "archive"))
    text = MAPPING
    if way == "archive":
        content = car.read_bytes()
        path.write_bytes(content[: chance.randrange(len(content) - 30)])
    else:
        lines[at] = {
            "unit": lines[at].replace("unit: ", "unit: [furlong] #"),
            "name": lines[at].replace("name: ", "name: no_such_"),
            "key": lines[at].replace("name: ", "nome: "),
            "cut": lines[at][: lines[at].index("{") + chance.randrange(1, 5)],
            "nan": lines[at]
            .replace("}", ", factor: .nan}")
            .replace("factor: 0.27", "offset: 0.27"),
        }[way]
        text = "\n".join(lines)
    path.with_suffix(".yaml").write_text(text, "utf-8")
    return path


@pytest.mark.parametrize(
    "seeds", [range(10), pytest.param(range(10, 110), marks=pytest.mark.slow)], ids=["10", "100"]
)
def test_foreign_cars_that_go_wrong_end_a_trip_with_one_message(
    ill_cars: dict[str, Path], tmp_path: Path, seeds: range, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong, usual_s = [], foreign_unit.TIMEOUT_S
    for seed in seeds:
        chance = random.Random(seed)  # noqa: S311
        way = chance.choice([DAMAGED, DAMAGED, *WAYS])
        monkeypatch.setattr(foreign_unit, "TIMEOUT_S", 0.5 if way == "not answered" else usual_s)
        car = damage(ill_cars[""], tmp_path, chance) if way == DAMAGED else ill_cars[way]
        message, duration_s = "silent", float(chance.randrange(20, 40))
        try:
            iptm.simulate("us06", duration_s=duration_s, plant=str(car))
        except IptmError as error:
            message = str(error)
        if "\n" in message or not re.search(way, message):
            wrong.append((seed, way, message))
    assert wrong == []
