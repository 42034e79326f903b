from __future__ import annotations

import pytest

from iptm_recording.selection import TopicSelection

NAMES = ["/plant/odometry", "/plant/powers", "/car_1/plant/powers", "/clock"]


@pytest.mark.parametrize(
    ("include", "exclude", "expected"),
    [
        ((), (), NAMES),
        (("/plant/*",), (), NAMES[:2]),
        (("plant/powers",), (), NAMES[1:3]),
        (("plant/*",), ("/plant/odometry",), NAMES[1:3]),
        ((), ("*",), []),
        (("clock",), (), ["/clock"]),
        (("/Plant/*",), (), []),
    ],
)
def test_patterns(include: tuple[str, ...], exclude: tuple[str, ...], expected: list[str]) -> None:
    selection = TopicSelection(include, exclude)
    assert [name for name in NAMES if selection.takes(name)] == expected


def test_typing_errors_are_found() -> None:
    assert TopicSelection(("/clok", "/clock"), ("plant/p*",)).unused(NAMES) == ["/clok"]
