"""What extras add: packages outside the core, found by the names of their modules and never named by it."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from types import ModuleType

PREFIX = "iptm_"
"""Beginning of the name of a package that may be an extra."""


@cache
def offered(part: str) -> tuple[ModuleType, ...]:
    """Return the modules ``extra_<part>`` of the installed packages, in the order of the packages' names.

    Args:
        part: what they add, such as "commands".
    """
    packages = sorted(module.name for module in iter_modules() if module.name.startswith(PREFIX))
    names = (f"{package}.extra_{part}" for package in packages)
    return tuple(import_module(name) for name in names if find_spec(name) is not None)
