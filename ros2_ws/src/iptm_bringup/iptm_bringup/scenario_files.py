"""Reads scenarios from YAML and from options, and refuses everything that it does not know.

    description: WLTC class 3b on hills, an unreliable radio link
    slope: small
    dropout_probability: 0.2
    parameter_overrides: {body.mass_kg: 1600}
    node_parameters: {controller: {deadline_ms: 50}}

What a file does not state keeps its default. Relative paths in a file start at its own folder.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, NoReturn

from iptm_bringup.scenario import NODES, Scalar, Scenario, scenario_specs
from iptm_core.errors import ParameterError, ScenarioError
from iptm_core.parameters.strict_yaml import parse_yaml, read_yaml
from iptm_interfaces.parameters import ParameterSpec, checked_value

DEFAULT_SCENARIO = "wltc"
_SUFFIXES = (".yaml", ".yml")
_OVERRIDES = "parameter_overrides"
_NODE_PARAMETERS = "node_parameters"
_FILE_OF = {"cycle": (".csv",), "parameter_set": _SUFFIXES}
"""Fields that may name a file, and by which suffixes that is seen."""


def scenario_folder() -> Path:
    """Return the folder of the shipped scenarios."""
    return Path(__file__).parent / "config" / "scenarios"


def shipped_scenarios() -> tuple[str, ...]:
    """Return the names of the shipped scenarios, the default first."""
    names = [path.stem for path in scenario_folder().glob("*.yaml")]
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_SCENARIO, name)))


def load_scenario(
    name_or_path: str | Path = DEFAULT_SCENARIO, options: Mapping[str, str] | None = None
) -> Scenario:
    """Read a scenario and lay options over it.

    Args:
        name_or_path: name of a shipped scenario, or the path of a YAML file.
        options: texts by field name, as typed on a command line.

    Returns:
        The scenario; types and ranges are checked, but not whether its parts fit together (see
        `iptm_bringup.preparation`).

    Raises:
        ScenarioError: no such scenario, a malformed file, an unknown key, a wrong type or range; the
            message names file or option, key, value and what is allowed.
    """
    path = _find(name_or_path)
    content = read_yaml(path, ScenarioError)
    return scenario_from(content, str(path), path.stem, path.parent, options)


def scenario_from(
    content: Any,
    origin: str,
    name: str,
    folder: Path,
    options: Mapping[str, str] | None = None,
) -> Scenario:
    """Build a scenario from the content of a file and options; see `load_scenario`.

    Args:
        content: what the YAML file holds.
        origin: what to call the file in a message.
        name: name of the scenario.
        folder: where relative paths start.
        options: texts by field name.
    """
    if content is None:
        content = {}
    if not isinstance(content, Mapping):
        raise ScenarioError(f"{origin}: holds {content!r}; allowed: a mapping of keys to values")
    specs = {spec.name: spec for spec in scenario_specs()}
    values: dict[str, Any] = {"name": name}
    for key, value in content.items():
        if key == "description":
            values[key] = _text(origin, key, value)
        elif key == _NODE_PARAMETERS:
            values[key] = _node_parameters(f"{origin}: {key}", value)
        elif key in specs:
            plain = _overrides_text(origin, value) if key == _OVERRIDES else value
            values[key] = _rooted(key, _checked(origin, specs[key], plain), folder)
        else:
            _refuse_unknown(origin, "key", key, [*specs, "description", _NODE_PARAMETERS])
    for key, text in (options or {}).items():
        spec = specs[key]
        option = f"option --{key.replace('_', '-')}"
        values[key] = _checked(option, spec, _typed(spec, text), says_key=False)
    return Scenario(**values)


def with_node_parameters(scenario: Scenario, assignments: Iterable[str]) -> dict[str, Any]:
    """Return a scenario's extra node parameters with ``node.name=value`` assignments laid over them.

    Raises:
        ScenarioError: an assignment is not of this form, or names no node.
    """
    merged = {node: dict(given) for node, given in scenario.node_parameters.items()}
    for assignment in assignments:
        key, separator, text = assignment.partition("=")
        node, dot, name = key.strip().partition(".")
        if not (separator and dot and name):
            raise ScenarioError(
                f"option --set is {assignment!r}; allowed: <node>.<parameter>=<value>, "
                f"with a node of {', '.join(NODES)}"
            )
        value = parse_yaml(text, "option --set", ScenarioError) if text.strip() else ""
        checked = _node_parameters("option --set", {node: {name: value}})
        merged.setdefault(node, {}).update(checked[node])
    return merged


def scenario_text(scenario: Scenario) -> str:
    """Return a scenario as the YAML text that `scenario_from` reads back."""
    content: dict[str, Any] = {
        entry.name: getattr(scenario, entry.name)
        for entry in fields(scenario)
        if entry.name not in {"name", _NODE_PARAMETERS}
    }
    if scenario.node_parameters:
        content[_NODE_PARAMETERS] = {
            node: dict(given) for node, given in scenario.node_parameters.items()
        }
    # JSON is YAML with every text in quotes; without them `1e3` would come back as a number.
    lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in content.items()]
    return "\n".join(lines) + "\n"


def _find(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    names = shipped_scenarios()
    if text in names:
        return scenario_folder() / f"{text}.yaml"
    path = Path(text)
    if path.suffix in _SUFFIXES or path.is_file():
        return path
    near = difflib.get_close_matches(text, names, n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    raise ScenarioError(
        f"scenario {text!r} is unknown; {hint}allowed: {', '.join(names)}, or the path of a .yaml file"
    )


def _checked(origin: str, spec: ParameterSpec, value: object, *, says_key: bool = True) -> Any:
    try:
        return checked_value(spec, value)
    except ParameterError as error:
        said = str(error).removeprefix("parameter ")
        if not says_key:
            said = said.removeprefix(f"{spec.name} ")
            raise ScenarioError(f"{origin} {said}") from None
        raise ScenarioError(f"{origin}: {said}") from None


def _typed(spec: ParameterSpec, text: str) -> Scalar:
    """Return a typed text as a number where the field is one; leave nonsense to the check."""
    if isinstance(spec.default, str):
        return text
    number = parse_yaml(text, f"option {spec.name}", ScenarioError)
    return number if isinstance(number, (int, float)) else text


def _rooted(key: str, value: Scalar, folder: Path) -> Scalar:
    """Let a relative file name start at the folder of the scenario."""
    suffixes = _FILE_OF.get(key, ())
    if isinstance(value, str) and value.lower().endswith(suffixes) and suffixes:
        return str(folder / value)
    return value


def _overrides_text(origin: str, value: Any) -> Any:
    """Return overrides given as a mapping in the form of one line, as node parameters carry them."""
    if not isinstance(value, Mapping):
        return value
    for key, number in value.items():
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            raise ScenarioError(
                f"{origin}: {_OVERRIDES}: {key} is {number!r}; allowed: a number in the unit of "
                "the model"
            )
    return ", ".join(f"{key}={number!r}" for key, number in value.items())


def _node_parameters(where: str, value: Any) -> dict[str, dict[str, Scalar]]:
    if not isinstance(value, Mapping):
        raise ScenarioError(f"{where} is {value!r}; allowed: {{<node>: {{<parameter>: <value>}}}}")
    result: dict[str, dict[str, Scalar]] = {}
    for node, given in value.items():
        if node not in NODES:
            _refuse_unknown(where, "node", node, NODES)
        if not isinstance(given, Mapping):
            raise ScenarioError(f"{where}: {node} is {given!r}; allowed: {{<parameter>: <value>}}")
        for name, entry in given.items():
            if not isinstance(entry, (bool, int, float, str)):
                raise ScenarioError(
                    f"{where}: {node}.{name} is {entry!r}; allowed: a number, a text, true or false"
                )
        result[node] = {str(name): entry for name, entry in given.items()}
    return result


def _text(origin: str, key: str, value: object) -> str:
    if not isinstance(value, str):
        raise ScenarioError(f"{origin}: {key} is {value!r}; allowed: a text")
    return value


def _refuse_unknown(origin: str, kind: str, name: object, known: Iterable[str]) -> NoReturn:
    names = list(known)
    near = difflib.get_close_matches(str(name), names, n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    raise ScenarioError(f"{origin}: unknown {kind} {name!r}; {hint}allowed: {', '.join(names)}")
