"""Trips by radio in which a received path, or a late message, decides the smallest gap."""

from __future__ import annotations

from pathlib import Path

from studies.v2x import price


def test_a_received_path_keeps_the_smallest_gap_as_the_file_does() -> None:
    """US06's hardest braking, where each m/s of a speed between the points is worth 8 m of the gap."""
    row = price.drive("us06", price.PATH, 0.02, duration_s=200.0)
    assert row["smallest_margin_m"] > 0.0


def test_late_messages_of_a_leader_that_brakes_suddenly_keep_the_smallest_gap(
    tmp_path: Path,
) -> None:
    """B24 goes from speeding up to braking with 3 m/s2 within a second, unheard for 1 s to 1.7 s."""
    file = price.measured_cycles(tmp_path)["B24"]
    row = price.drive("B24", price.DECAY, 2.8, 0.5, 1.0, duration_s=215.0, seed=1, file=file)
    assert row["smallest_margin_m"] > 0.0
