"""The environment of the processes of a run: their own ROS domain, this machine only, one thread each."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from iptm_bringup.scenario import AUTOMATIC_DOMAIN, MAX_DOMAIN
from iptm_core.errors import ScenarioError
from iptm_interfaces.discovery import middleware_settings, reserve_domain

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
def domain_of_run(asked: int, environment: Mapping[str, str] = os.environ) -> Iterator[RunDomain]:
    """Provide the ROS domain of a run.

    Args:
        asked: domain of the scenario, `AUTOMATIC_DOMAIN` for the user's or a free one.
        environment: where ``ROS_DOMAIN_ID`` may be set.

    Yields:
        The domain. A free one stays reserved until the context ends.

    Raises:
        ScenarioError: ``ROS_DOMAIN_ID`` is no domain, or none is free.
    """
    if asked != AUTOMATIC_DOMAIN:
        yield RunDomain(asked, is_private=False)
        return
    given = environment.get(DOMAIN_VARIABLE, "").strip()
    if not given:
        with reserve_domain() as domain:
            yield RunDomain(domain, is_private=True)
        return
    if not (given.isascii() and given.isdigit() and int(given) <= MAX_DOMAIN):
        raise ScenarioError(f"{DOMAIN_VARIABLE} is {given!r}; allowed: 0 to {MAX_DOMAIN}")
    yield RunDomain(int(given), is_private=False)


def environment_of_run(
    domain: int, log_folder: Path, base: Mapping[str, str] = os.environ
) -> dict[str, str]:
    """Return the environment for every process of a run; what the user has set is kept.

    Args:
        domain: ROS domain of the run.
        log_folder: where ROS writes its log files.
        base: environment to start from.
    """
    defaults = {
        # ROS from wheels does not say where it is installed.
        "AMENT_PREFIX_PATH": sys.prefix,
        # Four processes share the cores already.
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }
    chosen = {name: value for name, value in defaults.items() if not base.get(name)}
    return {
        **base,
        **chosen,
        # A run must not drive a plant in the next room.
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

    Args:
        environment: variables to set.
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
