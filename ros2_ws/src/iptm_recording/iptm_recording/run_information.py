"""What a run depended on, stored inside its bag so that it can be repeated years later.

The texts travel twice: as ``custom_data`` of ``metadata.yaml``, where ``ros2 bag`` shows them, and as
a metadata record at the very start of the MCAP file, where a kill or a lost folder cannot take them.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from importlib import metadata as package_metadata
from pathlib import Path
from typing import Any

import yaml

from iptm_core.errors import BagError

RECORD_NAME = "iptm_run"
UNKNOWN = "unknown"
_PACKAGES = ("numpy", "casadi", "ros-rclpy", "mcap", "rosbags", "iptm_core", "iptm_controller")
_GIT_TIMEOUT_S = 10.0


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
        """Read the texts of a bag; what is missing (another recorder) keeps its default.

        Raises:
            BagError: seed or versions are malformed.
        """
        rest = {str(key): str(value) for key, value in custom_data.items()}
        seed_text = rest.pop("seed", "")
        try:
            seed = int(seed_text) if seed_text else None
        except ValueError:
            raise BagError(f"seed of the run is {seed_text!r}, must be a whole number") from None
        try:
            versions = yaml.safe_load(rest.pop("versions", "")) or {}
        except yaml.YAMLError as error:
            raise BagError(f"versions of the run are not YAML: {error}") from None
        if not isinstance(versions, dict):
            raise BagError(f"versions of the run are {versions!r}, must be a mapping")
        return cls(
            scenario=rest.pop("scenario", ""),
            seed=seed,
            parameters=rest.pop("parameters", ""),
            git_revision=rest.pop("git_revision", UNKNOWN),
            versions={str(key): str(value) for key, value in versions.items()},
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
    """Complete what the caller knows about a run with revision, versions and the time of day.

    Args:
        scenario: name of the scenario.
        seed: seed of the random parts.
        parameters: YAML text, or a mapping of plain values to be written as such.
        extra: further texts by name.
    """
    text = parameters
    if not isinstance(text, str):
        text = yaml.safe_dump(dict(text), sort_keys=False)
    return RunInformation(
        scenario=scenario,
        seed=seed,
        parameters=str(text),
        git_revision=git_revision(),
        versions=installed_versions(),
        started_at_utc=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        extra=dict(extra or {}),
    )


def load_run_information(path: Path) -> RunInformation:
    """Complete the run information that a YAML file gives: scenario, seed, parameters, other texts.

    Raises:
        BagError: the file is missing or malformed.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    except (OSError, UnicodeDecodeError) as error:
        raise BagError(f"cannot read run information {path}: {error}") from None
    except yaml.YAMLError as error:
        raise BagError(f"run information {path} is not YAML: {error}") from None
    if not isinstance(content, dict):
        raise BagError(f"run information {path} must be a mapping, is {type(content).__name__}")
    scenario = content.pop("scenario", "")
    seed = content.pop("seed", None)
    parameters = content.pop("parameters", "")
    if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int)):
        raise BagError(f"run information {path}: seed is {seed!r}, must be a whole number")
    if not isinstance(parameters, (str, dict)):
        raise BagError(f"run information {path}: parameters must be a mapping or YAML text")
    return collect_run_information(
        scenario=str(scenario),
        seed=seed,
        parameters=parameters,
        extra={str(key): str(value) for key, value in content.items()},
    )


def git_revision(folder: Path | None = None) -> str:
    """Return the commit of the work tree that holds a folder, "-dirty" appended if it was changed.

    Args:
        folder: any folder of the work tree; this package's own by default.
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


def installed_versions() -> dict[str, str]:
    """Return the versions of Python, the platform and the libraries a run depends on."""
    versions = {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
    }
    installed = {name: _installed_version(name) for name in _PACKAGES}
    return {**versions, **{name: version for name, version in installed.items() if version}}


def _installed_version(name: str) -> str:
    try:
        return package_metadata.version(name)
    except package_metadata.PackageNotFoundError:
        return ""
