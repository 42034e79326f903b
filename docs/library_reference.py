"""The reference page of the library: what `import iptm` offers, from its signatures and docstrings."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any

import iptm


def library_page(notice: str) -> str:
    """Return the page; functions first, then classes with their public members, then constants."""
    entries = {name: getattr(iptm, name) for name in dir(iptm)}
    functions = {name: entry for name, entry in entries.items() if inspect.isfunction(entry)}
    classes = {name: entry for name, entry in entries.items() if inspect.isclass(entry)}
    constants = sorted(entries.keys() - functions.keys() - classes.keys())
    uses = (
        "`import iptm`: [notebooks](../how-to/notebooks.md); summaries hold [figures](figures.md)."
    )
    parts = [
        f"# The library\n\n{notice}{uses}\n",
        *(_entry("##", name, entry) for name, entry in functions.items()),
        *(part for name, entry in classes.items() for part in _class(name, entry)),
        "## Constants\n\n"
        + "\n".join(f"- `iptm.{name}`: {_names(entries[name])}" for name in constants),
    ]
    return "\n".join(parts) + "\n"


def _class(name: str, entry: type[Any]) -> Iterator[str]:
    yield _entry("##", name, entry)
    for member_name, member in vars(entry).items():
        target = member.fget if isinstance(member, property) else member
        target = getattr(target, "func", target)  # a cached property
        if member_name.startswith("_") or not inspect.isfunction(target):
            continue
        kind = "" if inspect.isfunction(member) else " (property)"
        yield _entry("###", f"{name}.{member_name}", target, kind)


def _entry(level: str, name: str, entry: Any, kind: str = "") -> str:
    """Return heading, signature and docstring; signatures of classes are in their docstrings."""
    text = inspect.getdoc(entry) or ""
    signature = ""
    if inspect.isfunction(entry) and not kind:
        parameters = [
            parameter.replace(annotation=inspect.Parameter.empty)
            for parameter in inspect.signature(entry).parameters.values()
            if parameter.name != "self"
        ]
        call = f"{name}{inspect.Signature(parameters)}"
        signature = f"{call if '.' in name else f'iptm.{call}'}\n\n"
    return f"{level} {name}{kind}\n\n```text\n{signature}{text}\n```\n"


def _names(entry: Any) -> str:
    return ", ".join(f"`{each}`" for each in entry)
