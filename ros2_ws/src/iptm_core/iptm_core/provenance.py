"""Where numbers come from: the commit of the source and the versions of what computed them."""

from __future__ import annotations

import platform
import shutil
import subprocess
from collections.abc import Iterable
from functools import lru_cache
from importlib import metadata
from pathlib import Path

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
