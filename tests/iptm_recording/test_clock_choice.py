"""The clock of a recording: one's own, or the only one there is, or none, with a word of warning."""

from __future__ import annotations

from iptm_recording.clock_choice import GRACE_S, ClockChoice
from iptm_recording.recorded_topics import TopicSelection

FIRST_SECOND = (0.0, 0.4, 0.9)


def looked(choice: ClockChoice, *clocks: str, has_data: bool = True) -> str:
    """Look for a second; return the warnings."""
    warnings = [choice.look(at_s, clocks, has_data=has_data) for at_s in FIRST_SECOND]
    assert FIRST_SECOND[-1] > GRACE_S
    return " ".join(filter(None, warnings))


def test_the_own_clock_comes_first() -> None:
    choice = ClockChoice("/car_1/clock", TopicSelection())
    assert looked(choice, "/car_2/clock", "/car_1/clock") == ""
    assert choice.clock == "/car_1/clock"
    assert choice.is_final


def test_the_only_clock_is_followed_once_there_are_data() -> None:
    choice = ClockChoice("/clock", TopicSelection())
    assert "--all" in looked(choice, "/car_7/clock", has_data=False)
    assert not choice.is_final
    assert "follows /car_7/clock" in looked(choice, "/car_7/clock")
    assert choice.clock == "/car_7/clock"


def test_a_namespace_that_was_asked_for_is_waited_for() -> None:
    """Its vehicle starts after another one."""
    choice = ClockChoice("/car_2/clock", TopicSelection())
    assert looked(choice, "/car_1/clock", has_data=False) == ""
    assert looked(choice, "/car_1/clock", "/car_2/clock", has_data=False) == ""
    assert choice.clock == "/car_2/clock"


def test_several_clocks_or_none_are_no_choice() -> None:
    for clocks, word in ((("/a/clock", "/b/clock"), "2 clocks"), ((), "no clock on the graph")):
        choice = ClockChoice("/clock", TopicSelection())
        warning = looked(choice, *clocks)
        assert word in warning
        assert "ordered by time of reception" in warning
        assert choice.clock is None
        assert choice.is_final


def test_an_excluded_clock_is_not_followed() -> None:
    choice = ClockChoice("/clock", TopicSelection(exclude=("/car_1/*",)))
    assert "no clock" in looked(choice, "/car_1/clock")
    assert choice.clock is None
