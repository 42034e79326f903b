"""The launch file of a string: a loop for each vehicle, in one graph."""

from __future__ import annotations

import runpy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from tests.iptm.runner.test_node_files import (
    SOURCE,
    Loop,
    Recorded,
    launch_stubs,
    needs_sources,
    of_class,
)

from iptm_core.errors import ScenarioError

__all__ = ["launch_stubs"]
LAUNCH = SOURCE / "extras" / "iptm_string" / "launch"


@needs_sources
def test_a_dead_vehicle_of_a_string_fails_the_launch_after_all_others(
    launch_stubs: list[Recorded],
) -> None:
    """Before, the launch ended with it, and with it the other vehicles."""
    module = runpy.run_path(str(LAUNCH / "string.launch.py"))
    driving = SimpleNamespace(is_shutdown=False)
    cars = [Loop(launch_stubs, fails_launch="false", record="false") for _ in range(2)]
    end = module["StringEnd"](6)
    for place, code in ((0, -9), (1, 0), (2, 0)):
        cars[0].end(place, code)
        end.on_exit(SimpleNamespace(returncode=code, process_name=f"car_1-{place}"), driving)
    for place in range(2):
        end.on_exit(SimpleNamespace(returncode=0, process_name="car_2"), driving)
        cars[1].end(place)
    with pytest.raises(RuntimeError, match="car_1-0 ended with exit code -9"):
        end.on_exit(SimpleNamespace(returncode=0, process_name="car_2"), driving)


def start_string(made: list[Recorded], module: dict[str, Any], **given: str) -> None:
    """Build the loops of a string with arguments."""
    defaults = {name: default for name, (default, _) in module["ARGUMENTS"].items()}
    (opaque,) = of_class(made, "OpaqueFunction")
    opaque.named["function"](SimpleNamespace(launch_configurations={**defaults, **given}))


@needs_sources
@pytest.mark.parametrize(
    ("given", "refusal"),
    [
        ({"vehicles": "0"}, "vehicles is 0; allowed: 2 to 20"),
        ({"vehicles": "abc"}, "vehicles is abc; allowed: 2 to 20"),
        ({"vehicles": "2.5"}, "vehicles is 2.5; allowed: a whole number, 2 to 20"),
        ({"vehicles": "100"}, "vehicles is 100; allowed: 2 to 20"),
        ({"leader_length_m": "nan"}, "leader.leader_length_m is 'nan'.*allowed: "),
    ],
)
def test_arguments_that_make_no_string_are_refused(
    launch_stubs: list[Recorded], given: dict[str, str], refusal: str
) -> None:
    module = runpy.run_path(str(LAUNCH / "string.launch.py"))
    module["generate_launch_description"]()
    with pytest.raises(ScenarioError, match=refusal):
        start_string(launch_stubs, module, **given)


@needs_sources
def test_the_vehicles_of_a_string_follow_each_other(launch_stubs: list[Recorded]) -> None:
    module = runpy.run_path(str(LAUNCH / "string.launch.py"))
    module["generate_launch_description"]()
    start_string(launch_stubs, module)
    given = [
        dict(item.named["launch_arguments"])
        for item in of_class(launch_stubs, "IncludeLaunchDescription")
    ]
    names = ["/car_1", "/car_2", "/car_3", "/car_4", "/car_5"]
    assert [entry["namespace"] for entry in given] == names
    assert [entry["vehicle_ahead"] for entry in given] == ["", *names[:-1]]
    assert [entry["vehicle_behind"] for entry in given] == [*names[1:], ""]
    assert [entry["leader_source"] for entry in given] == ["cycle", *["vehicle"] * 4]
    # 15 m from bumper to bumper, and 4.5 m of car.
    starts_m = [float(entry["start_position_m"]) for entry in given]
    assert starts_m == [0.0, -19.5, -39.0, -58.5, -78.0]
    assert [Path(entry["bag"]).name for entry in given] == [name[1:] for name in names]
    assert not any("clock" in entry for entry in given)  # the namespace moves it
    # Settings of the first vehicle must not apply to the second.
    groups = [item.arguments[0] for item in of_class(launch_stubs, "GroupAction")]
    assert groups == [[item] for item in of_class(launch_stubs, "IncludeLaunchDescription")]
    known = runpy.run_path(str(SOURCE / "iptm" / "launch" / "closed_loop.launch.py"))["ARGUMENTS"]
    assert all(entry.keys() <= known.keys() for entry in given)
