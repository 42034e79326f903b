"""Messages of one tick are joined by their stamps, and waited for."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iptm_controller.node_ticks import MatchedSet, StampMatcher
from iptm_core.errors import ParameterError
from iptm_ros.stamp_gate import StampGate, Verdict

SLOTS = ("state", "leader", "preview")
LEAD = ("state", ("leader", "preview"))
S = 1_000_000_000


def put_all(matcher: StampMatcher[str], stamp_ns: int, *slots: str) -> MatchedSet[str] | None:
    found = None
    for slot in slots or SLOTS:
        found = matcher.put(slot, stamp_ns, f"{slot}@{stamp_ns}")
    return found


def values(found: MatchedSet[str] | None) -> Any:
    assert found is not None
    return found.values


def test_the_last_missing_slot_fires() -> None:
    matcher = StampMatcher(*LEAD)
    assert matcher.put("leader", 5, "a") is None
    assert matcher.put("preview", 5, "b") is None
    found = matcher.put("state", 5, "c")
    assert found == MatchedSet(5, {"leader": "a", "preview": "b", "state": "c"}, Verdict.NEXT)
    assert matcher.last_ns == 5


def test_stamps_that_differ_by_a_nanosecond_do_not_match() -> None:
    matcher = StampMatcher("a", ("b",))
    assert matcher.put("a", 1_000_000_000, 0) is None
    assert matcher.put("b", 1_000_000_001, 0) is None
    assert matcher.missing() == (1_000_000_000, ("b",))


def test_messages_of_several_ticks_may_interleave() -> None:
    matcher = StampMatcher("a", ("b",))
    assert matcher.put("a", 1, "a1") is None
    assert matcher.put("a", 2, "a2") is None
    assert values(matcher.put("b", 1, "b1")) == {"a": "a1", "b": "b1"}
    assert values(matcher.put("b", 2, "b2")) == {"a": "a2", "b": "b2"}
    assert matcher.counts == {"matched": 2}


def test_missing_message_costs_its_tick_only() -> None:
    matcher = StampMatcher(*LEAD)
    put_all(matcher, 1, "state", "leader")
    assert matcher.missing() == (1, ("preview",))
    assert put_all(matcher, 2)
    assert matcher.missing() is None
    assert matcher.counts == {"matched": 1, "abandoned": 1}


def test_late_message_never_fires_an_old_tick() -> None:
    matcher = StampMatcher(*LEAD)
    put_all(matcher, 1, "state", "leader")
    put_all(matcher, 2)
    assert matcher.put("preview", 1, "late") is None
    assert matcher.put("preview", 2, "again") is None
    assert matcher.counts == {"matched": 1, "late": 2, "abandoned": 1}


def test_a_second_sender_shows_in_two_sets_in_a_row() -> None:
    """Once a message may come again for a state that came again, or late for a set that left without it."""
    matcher = StampMatcher(*LEAD, is_complete=lambda values: len(values) >= 2)
    for stamp_ns, again in ((1, ()), (2, ("leader",)), (3, ()), (4, ("leader",)), (5, ("leader",))):
        put_all(matcher, stamp_ns, "state", "leader", "preview", *again)
        assert matcher.counts["duplicate"] == (stamp_ns == 5)


def test_duplicate_replaces_the_value_and_does_not_complete_the_set() -> None:
    matcher = StampMatcher("a", ("b",))
    matcher.put("a", 1, "old")
    assert matcher.put("a", 1, "new") is None
    assert values(matcher.put("b", 1, "b")) == {"a": "new", "b": "b"}
    assert matcher.counts == {"matched": 1, "duplicate": 1}


def test_the_last_state_sent_again_is_told_once_each_time() -> None:
    """A plant repeats its state when it has no answer; the others need not repeat theirs."""
    matcher = StampMatcher(*LEAD)
    put_all(matcher, 1)
    for _ in range(3):
        assert matcher.put("leader", 1, "again") is None
        assert matcher.put("state", 1, "again") == MatchedSet(1, {}, Verdict.REPEATED)


def test_a_tick_of_the_trip_whose_state_alone_is_missing_can_be_answered() -> None:
    """The state was lost; stray answers, or parts of one, are no tick."""
    matcher = StampMatcher(*LEAD)
    put_all(matcher, 500 * S)
    put_all(matcher, 501 * S, "leader")
    put_all(matcher, 900 * S, "leader", "preview")
    assert not matcher.is_waiting
    put_all(matcher, 501 * S, "preview")
    assert matcher.missing() == (501 * S, ("state",))
    found = matcher.take_incomplete()
    assert found is not None
    assert (found.stamp_ns, found.verdict) == (501 * S, Verdict.NEXT)


def test_memory_is_bounded() -> None:
    matcher = StampMatcher("a", ("b",), max_pending=3)
    for stamp_ns in range(100):
        matcher.put("a", stamp_ns, stamp_ns)
    assert len(matcher._pending) == 3
    assert matcher.counts["abandoned"] == 97


@pytest.mark.parametrize("lead_s", [0.001, 1.5, 1000, 2**31 - 600])
@pytest.mark.parametrize("slots", [("leader",), ("preview",), ("leader", "preview")])
@pytest.mark.parametrize("spread_ns", [1, 7 * S // 5])
def test_no_number_of_stray_stamps_costs_the_present_tick(
    lead_s: float, slots: tuple[str, ...], spread_ns: int
) -> None:
    """Neither while the state waits for its leader, nor before the state is there."""
    matcher = StampMatcher(*LEAD)
    for tick in range(500, 505):
        assert put_all(matcher, tick * S)
    for here in ("state", "leader"):
        tick += 1
        matcher.put(here, tick * S, "here")
        for stray in range(100):
            put_all(matcher, tick * S + round(lead_s * S) + stray * spread_ns, *slots)
        rest = [slot for slot in SLOTS if slot != here]
        found = put_all(matcher, tick * S, *rest)
        assert values(found)[here] == "here"
    assert put_all(matcher, (tick + 1) * S)
    assert matcher.counts["late"] == 0


def test_stray_states_are_not_answered_instead_of_the_tick() -> None:
    matcher = StampMatcher(*LEAD)
    put_all(matcher, 500 * S)
    put_all(matcher, 501 * S, "state")
    for stray in range(100):
        matcher.put("state", 10**18 + stray, "stray")
    found = matcher.take_incomplete()
    assert found is not None
    assert (found.stamp_ns, set(found.values)) == (501 * S, {"state"})


def test_the_backlog_grows_only_where_nobody_waits() -> None:
    matcher = StampMatcher(*LEAD)
    put_all(matcher, 500 * S)
    matcher.put("leader", 501 * S, "")
    assert not matcher.is_waiting
    matcher.put("state", 501 * S, "")
    assert matcher.is_waiting
    assert matcher.backlog_ns == 0
    matcher.put("state", 503 * S, "")
    assert matcher.backlog_ns == 3 * S


@pytest.mark.parametrize("stamp_ns", [-1, -(2**62), 2**31 * S, 2**62])
def test_what_no_message_can_carry_back_is_counted_and_forgotten(stamp_ns: int) -> None:
    matcher = StampMatcher(*LEAD)
    for _ in range(50):
        assert put_all(matcher, stamp_ns) is None
    assert not matcher._pending
    assert matcher.gate.strays == 150
    assert put_all(matcher, 5)


def test_a_new_trip_begins_at_zero_at_once() -> None:
    matcher = StampMatcher(*LEAD)
    put_all(matcher, 10)
    matcher.put("leader", 12, "of the old trip")
    found = put_all(matcher, 0)
    assert found is not None
    assert found.verdict is Verdict.NEW_TRIP
    assert matcher.missing() is None
    assert matcher.last_ns == 0


def test_a_tick_in_the_making_survives_the_beginning_of_a_second_plant() -> None:
    """Its state is published once: a plant that waits in vain is silent, and the second one replaces it."""
    matcher = StampMatcher(*LEAD)
    for tick in (1, 2, 3):
        put_all(matcher, tick * S)
    put_all(matcher, 4 * S, "state")
    begun = put_all(matcher, 0)
    assert begun is not None
    assert begun.verdict is Verdict.NEW_TRIP
    found = put_all(matcher, 4 * S, "leader", "preview")
    assert found is not None
    assert found.verdict is Verdict.RESUMED
    assert matcher.missing() is None


def test_unknown_slot_is_refused() -> None:
    with pytest.raises(ParameterError, match="no slot 'x'; allowed: a, b"):
        StampMatcher("a", ("b",)).put("x", 0, 0)


def test_a_matcher_needs_room() -> None:
    with pytest.raises(ParameterError, match="room for 0 sets; allowed: at least 1"):
        StampMatcher(*LEAD, max_pending=0)


@given(
    st.lists(st.tuples(st.sampled_from(SLOTS), st.integers(1, 7)), max_size=60),
    st.integers(1, 4),
)
def test_whatever_the_order_sets_are_complete_unmixed_and_in_order(
    arrivals: list[tuple[str, int]], room: int
) -> None:
    matcher = StampMatcher(*LEAD, max_pending=room, gate=StampGate(lambda: 0.0))
    fired: list[int] = []
    for slot, stamp_ns in arrivals:
        found = matcher.put(slot, stamp_ns, (slot, stamp_ns))
        assert len(matcher._pending) <= room
        if found is not None and found.verdict is not Verdict.REPEATED:
            assert found.values == {name: (name, stamp_ns) for name in SLOTS}
            fired.append(stamp_ns)
    assert fired == sorted(set(fired))
    assert matcher.counts["matched"] == len(fired)
