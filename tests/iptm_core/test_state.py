"""States come back from files to the last bit; a preview with bounds: what of it is known."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

import numpy as np
import pytest

from iptm_core.errors import StateError
from iptm_core.saved_state import SavedState, from_plain, read_state, to_plain, write_state
from iptm_core.state import (
    KNOWN_BOUND_M,
    ChannelCells,
    FloatArray,
    FullChannelState,
    LeaderPreview,
    VehicleState,
)

SETTINGS = {"cycle": "us06", "period_s": 1.0}


class Colour(Enum):
    RED = "red"


@dataclass(frozen=True)
class Inner:
    name: str
    colour: Colour


@dataclass(frozen=True, eq=False)
class Outer:
    number: float
    rows: FloatArray
    inside: tuple[Inner, ...]
    maybe: Inner | None
    state: VehicleState


def example() -> Outer:
    cells = ChannelCells(np.array([0.1, 0.2, 0.30000000000000004]), np.array([1e-3, 2e-3, 1 / 3]))
    state = FullChannelState(
        1.0,
        2.0,
        3.0,
        0.1 + 0.2,
        0.0,
        0.1,
        0.30000000000000004,
        1e-3,
        1 / 3,
        cells,
        state_of_charge=1 / 7,
    )
    inner = Inner("a", Colour.RED)
    return Outer(-math.inf, np.array([[math.pi], [5e-324]]), (inner, inner), None, state)


def test_every_number_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    before = example()
    path = tmp_path / "made" / "state.json"
    write_state(path, SavedState("outer", 20 * 10**9, SETTINGS, to_plain(before)))
    saved = read_state(path, "outer", SETTINGS)
    after = from_plain(Outer, saved.state)
    assert saved.stamp_ns == 20 * 10**9
    assert (after.number, after.inside, after.maybe) == (before.number, before.inside, None)
    np.testing.assert_array_equal(after.rows, before.rows)
    assert after.state == before.state
    assert isinstance(after.state, FullChannelState)
    assert [file.name for file in path.parent.iterdir()] == ["state.json"]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("number", "1", "state.number is '1'"),
        ("number", 1, "state.number is 1"),
        ("rows", [[1.0], []], "state.rows"),
        ("inside", [{"name": "a"}], r"state.inside\[0\] has the keys name"),
        ("inside", [{"name": "a", "colour": "blue"}], "colour is 'blue'; allowed: red"),
        ("maybe", 3, "state.maybe is 3"),
        ("state", None, "state.state is None"),
    ],
)
def test_what_is_no_state_is_refused(key: str, value: object, words: str) -> None:
    plain = to_plain(example())
    plain[key] = value
    with pytest.raises(StateError, match=words):
        from_plain(Outer, plain)


def test_other_settings_and_other_kinds_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    write_state(path, SavedState("plant", 0, SETTINGS, {}))
    with pytest.raises(StateError, match="saved with cycle 'us06', this node has 'nycc'"):
        read_state(path, "plant", {**SETTINGS, "cycle": "nycc"})
    with pytest.raises(StateError, match="state of 'plant'; allowed: that of 'controller'"):
        read_state(path, "controller", SETTINGS)
    document = json.loads(path.read_text())
    path.write_text(json.dumps({**document, "stamp_ns": -1}))
    with pytest.raises(StateError, match="stamp_ns is -1"):
        read_state(path, "plant", SETTINGS)
    with pytest.raises(StateError, match="cannot be written"):
        write_state(path / "below" / "a_file.json", SavedState("plant", 0, SETTINGS, {}))


TIMES = np.arange(5.0)
KNOWN = LeaderPreview(TIMES, 20.0 + 10.0 * TIMES, np.full(5, 10.0))


def test_without_bounds_all_is_known() -> None:
    assert (KNOWN.known_nodes, KNOWN.known_until_s) == (5, 4.0)
    assert KNOWN.cautious() is KNOWN


@pytest.mark.parametrize(
    ("bounds", "nodes", "until_s"),
    [
        ([0.0, 0.5, KNOWN_BOUND_M, 1.6, 9.0], 3, 2.0),
        ([0.0, 0.1, 0.2, 0.3, 0.4], 5, 4.0),
        ([0.0, 2.0, 1.0, 1.0, 1.0], 1, 0.0),
        ([2.0, 2.0, 2.0, 2.0, 2.0], 0, -math.inf),
    ],
)
def test_known_is_what_comes_before_the_first_large_bound(
    bounds: list[float], nodes: int, until_s: float
) -> None:
    preview = replace(KNOWN, bounds_m=np.array(bounds))
    assert (preview.known_nodes, preview.known_until_s) == (nodes, until_s)


def test_nothing_of_an_empty_preview_is_known() -> None:
    empty = LeaderPreview.empty()
    assert (empty.known_nodes, empty.known_until_s) == (0, -math.inf)


def test_cautious_motion_by_hand() -> None:
    preview = replace(KNOWN, bounds_m=np.array([1.0, 2.0, 5.0, 10.0, 41.0]))
    cautious = preview.cautious()
    # 59, 60 m less 10, 41 m: the leader does not drive backwards from where it was.
    assert cautious.positions_m.tolist() == [19.0, 28.0, 35.0, 40.0, 40.0]
    # Twice the mean rates of 1, 2, 3 and 10 m/s since the first node.
    assert cautious.speeds_m_s.tolist() == [10.0, 8.0, 6.0, 4.0, 0.0]
    assert cautious.bounds_m.size == 0
