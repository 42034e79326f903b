"""YAML as the configuration files of this project need it: YAML 1.2 scalars, no duplicate keys, bounded.

PyYAML's own loader follows YAML 1.1, where ``1e-4`` is a string, ``1:30`` the number 90, ``010``
eight, ``no`` false, and where the second of two equal keys silently wins. Each of these turns a typing
slip into a wrong number, so this loader supports none of them.

Whatever the text, reading ends soon and takes little memory: size, depth and the number of values that
references (`*name`) stand for are bounded.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NoReturn

import yaml

from iptm_core.errors import IptmError, ParameterError
from iptm_core.user_input import read_file

YAML_SUFFIXES = (".yaml", ".yml")
MAX_BYTES = 500_000
_MAX_DEPTH = 50
_MAX_VALUES = 200_000
"""With references written out; a text of `MAX_BYTES` without any cannot reach it by much."""


# libyaml's parser where PyYAML was built with it: ten times as fast.
_Parser: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _StrictLoader(_Parser):  # type: ignore[misc]  # PyYAML ships no type information
    """Safe loader with the core schema of YAML 1.2 and without duplicate keys."""

    yaml_implicit_resolvers: dict[str, Any] = {}  # noqa: RUF012  (the name PyYAML looks up)

    def construct_mapping(self, node: Any, deep: bool = False) -> dict[Any, Any]:  # noqa: FBT001, FBT002
        """Build a mapping and refuse a key that occurs twice."""
        mapping: dict[Any, Any] = {}
        for key_node, value_node in node.value:
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, str | int | float):
                raise yaml.constructor.ConstructorError(
                    None, None, f"a key must be plain text, got {key!r}", key_node.start_mark
                )
            if key in mapping:
                raise yaml.constructor.ConstructorError(
                    None, None, f"the key {key!r} occurs twice", key_node.start_mark
                )
            mapping[key] = self.construct_object(value_node, deep=deep)
        return mapping


_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:null", re.compile(r"^(?:~|null|)$"), ["~", "n", ""]
)
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:bool", re.compile(r"^(?:true|True|false|False)$"), list("tTfF")
)
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:int", re.compile(r"^[-+]?(?:0|[1-9][0-9]*)$"), list("-+0123456789")
)
_StrictLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(
        r"^(?:[-+]?(?:\.[0-9]+|(?:0|[1-9][0-9]*)(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?"
        r"|[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))$"
    ),
    list("-+.0123456789"),
)


def parse_yaml(text: str, origin: str, error: type[IptmError] = ParameterError) -> Any:
    """Parse one YAML document.

    An error of the given class is raised if the text is not YAML, repeats a key, nests too deeply, or is or
    becomes too large.
    """
    if len(text) > MAX_BYTES:
        raise error(f"{origin}: {len(text)} characters; at most {MAX_BYTES} are read")
    try:
        _check_bounds(text)
        loader = _StrictLoader(text)
        try:
            return loader.get_single_data()
        finally:
            loader.dispose()
    except (yaml.YAMLError, ValueError) as reason:
        words = " ".join(str(reason).split())[:300]
        raise error(f"{origin}: not valid YAML: {words}") from reason


def _check_bounds(text: str) -> None:
    """Refuse what nests too deeply or stands for too many values, before anything is built of it."""
    counts = [0]  # of values, by the collections that are open
    names: list[str | None] = [None]
    sizes: dict[str, int] = {}
    for event in yaml.parse(text, Loader=_Parser):
        if isinstance(event, yaml.CollectionStartEvent):
            counts.append(1)
            names.append(event.anchor)
            if len(counts) - 1 > _MAX_DEPTH:
                _refuse(f"nested more than {_MAX_DEPTH} deep", event)
            continue
        if isinstance(event, yaml.CollectionEndEvent):
            size, name = counts.pop(), names.pop()
        elif isinstance(event, yaml.ScalarEvent):
            size, name = 1, event.anchor
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor in names:
                _refuse("a value contains itself", event)
            size, name = sizes.get(event.anchor, 1), None
        else:
            continue
        if name is not None:
            sizes[name] = size
        counts[-1] += size
        if counts[-1] > _MAX_VALUES:
            _refuse(f"more than {_MAX_VALUES} values, references counted", event)


def _refuse(reason: str, event: Any) -> NoReturn:
    raise yaml.composer.ComposerError(None, None, reason, event.start_mark)


def read_yaml(path: Path, error: type[IptmError] = ParameterError) -> Any:
    """Read and parse one YAML file; errors as in ``parse_yaml``, and for an unreadable file."""
    try:
        text = read_file(path, MAX_BYTES, error).decode("utf-8")
    except UnicodeDecodeError as reason:
        raise error(f"{path}: cannot be read as UTF-8 text: {reason}") from reason
    return parse_yaml(text, str(path), error)
