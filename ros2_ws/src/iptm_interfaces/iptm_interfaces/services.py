"""Every service of the suite, as data: names, types, servers and what they do.

Names are relative like those of the topics, so that a namespace moves them with the vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

from std_srvs.srv import Trigger


class Service(Enum):
    """Key of a service; the value is its name."""

    PAUSE = "plant/pause"
    RESUME = "plant/resume"
    STEP = "plant/step"
    RESET = "plant/reset"


@dataclass(frozen=True)
class ServiceSpec:
    """What a service promises; all are `std_srvs/srv/Trigger`, whose message tells what was done or why not.

    Attributes:
        service: key; `service.value` is the name.
        server: node that offers it.
        meaning: what it does.
    """

    service: Service
    server: str
    meaning: str
    service_type: type = Trigger


_SPECS = (
    ServiceSpec(
        Service.PAUSE,
        "plant",
        "hold the trip: in lock-step at the present state, in real time at the next one, before the start "
        "at the first one; the state is repeated every second, so that nobody takes the plant for dead",
    ),
    ServiceSpec(Service.RESUME, "plant", "go on with a trip that is paused"),
    ServiceSpec(
        Service.STEP,
        "plant",
        "drive one interval of a trip that is paused: in lock-step as soon as the command has arrived that "
        "answers the present state, in real time at once",
    ),
    ServiceSpec(
        Service.RESET,
        "plant",
        "begin a new trip from the start, which the other nodes follow; one that is paused stays so",
    ),
)

SERVICES: Mapping[Service, ServiceSpec] = MappingProxyType({spec.service: spec for spec in _SPECS})
"""The table: specification of every service by its key."""


def service_table_markdown() -> str:
    """Return one row per service."""
    lines = ["| service | type | server | what it does |", "|---|---|---|---|"]
    lines += [
        f"| `{spec.service.value}` | `std_srvs/{spec.service_type.__name__}` | {spec.server} "
        f"| {spec.meaning} |"
        for spec in _SPECS
    ]
    return "\n".join(lines) + "\n"
