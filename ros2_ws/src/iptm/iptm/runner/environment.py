"""The environment of the processes of a run: their own ROS domain, this machine only, one thread each."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from iptm.trip_settings import AUTOMATIC_DOMAIN, MAX_DOMAIN
from iptm_core.errors import ScenarioError
from iptm_ros.discovery import check_nodes_can_meet, lock_run, middleware_settings, reserve_domain

DOMAIN_VARIABLE = "ROS_DOMAIN_ID"


@dataclass(frozen=True)
class RunDomain:
    """ROS domain of a run.

    Attributes:
        number: domain id.
        is_private: whether it was reserved for this run alone; in a domain that the user chose,
            viewers may be there already.
    """

    number: int
    is_private: bool


@contextmanager
def domain_of_run(
    requested: int, namespace: str = "/", environment: Mapping[str, str] = os.environ
) -> Iterator[RunDomain]:
    """Provide the ROS domain of a run, which no other run has in the same namespace until the context ends.

    Args:
        requested: domain of the scenario, `AUTOMATIC_DOMAIN` for the user's or a free one.
        namespace: full namespace of the run, `/` for none.
        environment: where ``ROS_DOMAIN_ID`` may be set.

    Raises:
        ScenarioError: ``ROS_DOMAIN_ID`` is invalid, another run uses the domain, none is free, or nodes
            cannot find each other in this environment.
    """
    given = environment.get(DOMAIN_VARIABLE, "").strip() if requested == AUTOMATIC_DOMAIN else ""
    if given and not (given.isascii() and given.isdigit() and int(given) <= MAX_DOMAIN):
        raise ScenarioError(f"{DOMAIN_VARIABLE} is {given!r}; allowed: 0 to {MAX_DOMAIN}")
    check_nodes_can_meet(environment)
    is_private = requested == AUTOMATIC_DOMAIN and not given
    with ExitStack() as stack:
        number = int(given) if given else requested
        if is_private:
            number = stack.enter_context(reserve_domain())
        stack.enter_context(lock_run(number, namespace))
        yield RunDomain(number, is_private)


def environment_of_run(
    domain: int, log_folder: Path, base: Mapping[str, str] = os.environ
) -> dict[str, str]:
    """Return the environment for every process of a run; what the user has set is kept."""
    defaults = {
        # ROS from wheels does not set its install prefix.
        "AMENT_PREFIX_PATH": sys.prefix,
        # Four processes already share the cores.
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    chosen = {name: value for name, value in defaults.items() if not base.get(name)}
    return {
        **base,
        **chosen,
        # Keep the run on this machine: it must not reach a plant elsewhere on the network.
        **middleware_settings(base),
        DOMAIN_VARIABLE: str(domain),
        "ROS_LOG_DIR": str(log_folder),
        "RCUTILS_COLORIZED_OUTPUT": "0",
        "PYTHONUNBUFFERED": "1",
    }


@contextmanager
def process_environment(environment: Mapping[str, str]) -> Iterator[None]:
    """Give this process an environment until the context ends.

    A process that takes part in the graph itself needs it: ROS and Fast DDS read their settings from
    the environment of the process when a node is built.
    """
    before = {name: os.environ.get(name) for name in environment}
    os.environ.update(environment)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value
