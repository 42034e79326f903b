"""Inputs of a run, stored inside its bag so that it can be repeated years later.

The texts travel twice: as `custom_data` of `metadata.yaml`, where `ros2 bag` shows them, and as
a metadata record at the very start of the MCAP file, where a kill or a lost folder cannot take them.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

import yaml

from iptm_core.errors import BagError, ParameterError
from iptm_core.parameters import ModelParameters, flat_to_parameters
from iptm_core.parameters.strict_yaml import parse_yaml, read_yaml
from iptm_core.user_input import shown

UNKNOWN = "unknown"
_GIT_TIMEOUT_S = 10.0


@lru_cache(maxsize=4)
def git_revision(folder: Path | None = None) -> str:
    """Return the commit of the work tree that holds a folder (None: this package), as at the first call.

    It is the full hash, with ``-dirty`` appended if a tracked file was changed; ``unknown`` outside git.
    """
    git = shutil.which("git")
    if git is None:
        return UNKNOWN
    try:
        done = subprocess.run(  # noqa: S603 - fixed arguments
            [git, "describe", "--always", "--abbrev=40", "--dirty", "--exclude=*"],
            cwd=folder or Path(__file__).resolve().parent,
            capture_output=True,
            check=True,
            text=True,
            timeout=_GIT_TIMEOUT_S,
        )
    except (OSError, subprocess.SubprocessError):
        return UNKNOWN
    return done.stdout.strip() or UNKNOWN


def versions(packages: Iterable[str]) -> dict[str, str]:
    """Return the versions of Python, the platform and the installed packages."""
    return {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        **{name: version for name in packages if (version := installed_version(name)) != UNKNOWN},
    }


def installed_version(package: str) -> str:
    """Return the version of a distribution, ``unknown`` if it is not installed."""
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return UNKNOWN


RECORD_NAME = "iptm_run"
MODEL_KEY = "model"
"""Entry of the run's parameters that holds the model's, as `to_flat_dict` gives them."""
PAUSES_KEY = "pauses"
"""Key of the text of a bag that lists the pauses of the recording."""
LOST_KEY = "lost_messages"
_PACKAGES = ("numpy", "casadi", "ros-rclpy", "mcap", "rosbags", "iptm_core", "iptm_controller")


@dataclass(frozen=True)
class RunInformation:
    """Everything that a run depended on.

    Attributes:
        scenario: name of the scenario, "" when there was none.
        seed: seed of the random parts, None when there were none.
        parameters: parameters of the model and of the nodes, as YAML text.
        git_revision: commit of the source, with "-dirty" when it was changed; "unknown" outside git.
        versions: versions of the interpreter, of the platform and of the libraries, by name.
        started_at_utc: start of the recording, ISO 8601.
        extra: further texts by name.
    """

    scenario: str = ""
    seed: int | None = None
    parameters: str = ""
    git_revision: str = UNKNOWN
    versions: Mapping[str, str] = field(default_factory=dict)
    started_at_utc: str = ""
    extra: Mapping[str, str] = field(default_factory=dict)

    def to_custom_data(self) -> dict[str, str]:
        """Return the texts by name, as a bag stores them."""
        return {
            **{str(key): str(value) for key, value in self.extra.items()},
            "scenario": self.scenario,
            "seed": "" if self.seed is None else str(self.seed),
            "parameters": self.parameters,
            "git_revision": self.git_revision,
            "versions": yaml.safe_dump(dict(self.versions), sort_keys=True),
            "started_at_utc": self.started_at_utc,
        }

    @classmethod
    def from_custom_data(cls, custom_data: Mapping[str, str]) -> RunInformation:
        """Read the texts of a bag; missing ones (another recorder) keep their defaults."""
        rest = {str(key): str(value) for key, value in custom_data.items()}
        seed_text = rest.pop("seed", "")
        try:
            seed = int(seed_text) if seed_text else None
        except ValueError:
            raise BagError(f"seed of the run is {seed_text!r}; allowed: a whole number") from None
        known = parse_yaml(rest.pop("versions", ""), "versions of the run", BagError) or {}
        if not isinstance(known, dict):
            raise BagError(f"versions of the run are {shown(known)}; allowed: a mapping")
        return cls(
            scenario=rest.pop("scenario", ""),
            seed=seed,
            parameters=rest.pop("parameters", ""),
            git_revision=rest.pop("git_revision", UNKNOWN),
            versions={str(key): str(value) for key, value in known.items()},
            started_at_utc=rest.pop("started_at_utc", ""),
            extra=rest,
        )


def collect_run_information(
    *,
    scenario: str = "",
    seed: int | None = None,
    parameters: str | Mapping[str, Any] = "",
    extra: Mapping[str, str] | None = None,
) -> RunInformation:
    """Complete the information about a run with revision, versions and the time of day."""
    text = parameters
    if not isinstance(text, str):
        text = yaml.safe_dump(dict(text), sort_keys=False)
    return RunInformation(
        scenario=scenario,
        seed=seed,
        parameters=str(text),
        git_revision=git_revision(),
        versions=versions(_PACKAGES),
        started_at_utc=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        extra=dict(extra or {}),
    )


def load_run_information(path: Path) -> RunInformation:
    """Complete the run information that a YAML file gives: scenario, seed, parameters, other texts."""
    content = read_yaml(path, BagError) or {}
    if not isinstance(content, dict):
        raise BagError(f"run information {path} is a {type(content).__name__}; allowed: a mapping")
    scenario = content.pop("scenario", "")
    seed = content.pop("seed", None)
    parameters = content.pop("parameters", "")
    if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int)):
        raise BagError(f"run information {path}: seed is {shown(seed)}; allowed: a whole number")
    if not isinstance(parameters, (str, dict)):
        kind = type(parameters).__name__
        raise BagError(f"run information {path}: parameters are a {kind}; allowed: mapping, text")
    return collect_run_information(
        scenario=str(scenario),
        seed=seed,
        parameters=parameters,
        extra={str(key): str(value) for key, value in content.items()},
    )


def stored_pauses(information: RunInformation) -> list[tuple[float, float]]:
    """Return the pauses of a recording that began and ended within it: last tick before, last inside (s)."""
    text = information.extra.get(PAUSES_KEY, "")
    pauses = parse_yaml(text, "pauses of the recording", BagError) or []
    try:
        found = [(pause["after_s"], pause["until_s"]) for pause in pauses]
        return [(float(a), float(b)) for a, b in found if a is not None and b is not None]
    except (TypeError, KeyError, ValueError):
        raise BagError(
            f"pauses of the recording are {shown(text)}; allowed: after_s, until_s"
        ) from None


def stored_losses(information: RunInformation) -> dict[str, int]:
    """Return how many messages never reached the recorder, by full name of the topic."""
    text = information.extra.get(LOST_KEY, "")
    losses = parse_yaml(text, "messages lost by the recorder", BagError) or {}
    try:
        return {str(name): int(count) for name, count in losses.items()}
    except (AttributeError, TypeError, ValueError):
        raise BagError(
            f"messages lost by the recorder are {shown(text)}; allowed: topic: number"
        ) from None


def stored_model_parameters(information: RunInformation) -> ModelParameters | None:
    """Return the model parameters that a run was made with, None if its bag lacks them.

    Raises:
        BagError: there are some, but malformed.
    """
    parameters = parse_yaml(information.parameters, "parameters of the run", BagError)
    if not isinstance(parameters, dict) or MODEL_KEY not in parameters:
        return None
    try:
        return flat_to_parameters(parameters[MODEL_KEY], "parameters of the run")
    except ParameterError as error:
        raise BagError(str(error)) from None
