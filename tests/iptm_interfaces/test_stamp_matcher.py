from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_core.errors import ParameterError
from iptm_interfaces.stamp_matcher import MatcherCounts, StampMatcher

SLOTS = ("state", "leader", "preview")


def put_all(matcher: StampMatcher, stamp_ns: int, *slots: str) -> Any:
    found = None
    for slot in slots or SLOTS:
        found = matcher.put(slot, stamp_ns, f"{slot}@{stamp_ns}")
    return found


def test_the_last_missing_slot_fires() -> None:
    matcher = StampMatcher(SLOTS)
    assert matcher.put("leader", 5, "a") is None
    assert matcher.put("preview", 5, "b") is None
    assert matcher.put("state", 5, "c") == {"leader": "a", "preview": "b", "state": "c"}
    assert matcher.last_ns == 5


def test_stamps_that_differ_by_a_nanosecond_do_not_match() -> None:
    matcher = StampMatcher(("a", "b"))
    assert matcher.put("a", 1_000_000_000, 0) is None
    assert matcher.put("b", 1_000_000_001, 0) is None
    assert matcher.missing() == (1_000_000_001, ("a",))


def test_messages_of_several_ticks_may_interleave() -> None:
    matcher = StampMatcher(("a", "b"))
    assert matcher.put("a", 1, "a1") is None
    assert matcher.put("a", 2, "a2") is None
    assert matcher.put("b", 1, "b1") == {"a": "a1", "b": "b1"}
    assert matcher.put("b", 2, "b2") == {"a": "a2", "b": "b2"}
    assert matcher.counts == MatcherCounts(matched=2)


def test_missing_message_costs_its_tick_only() -> None:
    matcher = StampMatcher(SLOTS)
    put_all(matcher, 1, "state", "leader")
    assert matcher.missing() == (1, ("preview",))
    assert put_all(matcher, 2)
    assert matcher.missing() is None
    assert matcher.counts == MatcherCounts(matched=1, abandoned=1)


def test_late_message_never_fires_an_old_tick() -> None:
    matcher = StampMatcher(SLOTS)
    put_all(matcher, 1, "state", "leader")
    put_all(matcher, 2)
    assert matcher.put("preview", 1, "late") is None
    assert matcher.put("preview", 2, "again") is None
    assert matcher.counts == MatcherCounts(matched=1, late=2, abandoned=1)


def test_duplicate_replaces_the_value_and_does_not_complete_the_set() -> None:
    matcher = StampMatcher(("a", "b"))
    matcher.put("a", 1, "old")
    assert matcher.put("a", 1, "new") is None
    assert matcher.put("b", 1, "b") == {"a": "new", "b": "b"}
    assert matcher.counts == MatcherCounts(matched=1, duplicate=1)


def test_memory_is_bounded_and_the_oldest_goes_first() -> None:
    matcher = StampMatcher(("a", "b"), max_pending=3)
    for stamp_ns in range(100):
        matcher.put("a", stamp_ns, stamp_ns)
    assert len(matcher._pending) == 3
    assert matcher.counts.abandoned == 97
    assert matcher.put("b", 99, 0) == {"a": 99, "b": 0}


def test_reset_lets_a_new_trip_begin_at_zero() -> None:
    matcher = StampMatcher(("a",))
    assert matcher.put("a", 10, 1)
    assert matcher.put("a", 0, 1) is None
    matcher.reset()
    assert matcher.put("a", 0, 1)
    assert matcher.last_ns == 0


def test_unknown_slot_is_refused() -> None:
    with pytest.raises(ParameterError, match="no slot 'x'; allowed: a, b"):
        StampMatcher(("a", "b")).put("x", 0, 0)


@pytest.mark.parametrize(("slots", "room"), [((), 4), (("a",), 0)])
def test_a_matcher_needs_slots_and_room(slots: tuple[str, ...], room: int) -> None:
    with pytest.raises(ParameterError, match="at least 1 of each"):
        StampMatcher(slots, room)


@given(
    st.lists(st.tuples(st.sampled_from(SLOTS), st.integers(0, 6)), max_size=60),
    st.integers(1, 4),
)
def test_whatever_the_order_sets_are_complete_unmixed_and_in_order(
    arrivals: list[tuple[str, int]], room: int
) -> None:
    matcher = StampMatcher(SLOTS, room)
    fired: list[int] = []
    for slot, stamp_ns in arrivals:
        values = matcher.put(slot, stamp_ns, (slot, stamp_ns))
        assert len(matcher._pending) <= room
        if values is not None:
            assert values == {name: (name, stamp_ns) for name in SLOTS}
            fired.append(stamp_ns)
    assert fired == sorted(set(fired))
    assert matcher.counts.matched == len(fired)
