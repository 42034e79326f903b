"""Reads scenarios from YAML and from options; unknown keys are errors.

    description: WLTC class 3b on hills, an unreliable radio link
    slope: small
    dropout_probability: 0.2
    overrides: {body.mass_kg: 1600}
    node_parameters: {controller: {deadline_ms: 50}}
    faults: [{kind: leader_hard_stop, start_s: 120, duration_s: 10, size: 8}]

What a file does not state keeps its default. Relative paths in a file start at its own folder.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from iptm.faults.fault import faults_from, plain_faults
from iptm.runner.scenario import NODES, Scenario
from iptm_core.declaration import ParameterSpec, Scalar, checked_value, parameter_specs, plain
from iptm_core.errors import ParameterError, ScenarioError
from iptm_core.parameters.strict_yaml import YAML_SUFFIXES, parse_yaml, read_yaml
from iptm_core.routes.user_csv import GPX_SUFFIX, USER_SUFFIXES
from iptm_core.user_input import StrictMapping, is_path, shown, suggestion

DEFAULT_SCENARIO = "wltc"
LONGEST_NAME = 100
"""Characters of the name of a scenario, which become a part of file names."""
_OVERRIDES = "overrides"
_NODE_PARAMETERS = "node_parameters"
_FAULTS = "faults"
_FILE_OF = {"cycle": USER_SUFFIXES, "slope": (GPX_SUFFIX,), "parameter_set": YAML_SUFFIXES}
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
        `iptm.runner.scenario`).

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
        name: name of the scenario; the default one is named after a cycle among the options.
        folder: where relative paths start.
        options: texts by field name.
    """
    specs = {spec.name: spec for spec in parameter_specs(Scenario)}
    written = StrictMapping(
        {} if content is None else content,
        origin,
        [*specs, "description", _NODE_PARAMETERS, _FAULTS],
    )
    values: dict[str, Any] = {"name": name}
    for key, value in written.content.items():
        if key == "description":
            values[key] = written.text(key)
        elif key == _NODE_PARAMETERS:
            values[key] = _node_parameters(written.section(key, NODES, kind="node"))
        elif key == _FAULTS:
            values[key] = faults_from(value, origin)
        else:
            given = _overrides_text(written) if key == _OVERRIDES else value
            values[key] = _rooted(key, _checked(f"{origin}: ", specs[key], given), folder)
    for key, text in (options or {}).items():
        option = specs[key]
        as_typed = replace(option, name=key.replace("_", "-"))
        values[key] = _checked("option --", as_typed, _typed(option, text))
    if name == DEFAULT_SCENARIO and "cycle" in (options or {}):
        values["name"] = _name_of(str(values["cycle"]))
    try:
        return Scenario(**values)
    except ParameterError as error:
        raise ScenarioError(f"scenario {name}: {error}") from None


def _name_of(cycle: str) -> str:
    """Return the name of a cycle without folder and suffix, as far as it fits into the name of a folder."""
    stem = Path(cycle.partition("#")[0]).stem
    return re.sub(r"[^\w.-]+", "_", stem)[:LONGEST_NAME] or DEFAULT_SCENARIO


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
        given = StrictMapping({node: {name: value}}, "option --set", NODES, kind="node")
        checked = _node_parameters(given)
        merged.setdefault(node, {}).update(checked[node])
    return merged


def scenario_text(scenario: Scenario) -> str:
    """Return a scenario as the YAML text that `scenario_from` reads back."""
    content: dict[str, Any] = {
        "description": scenario.description,
        **{spec.name: plain(getattr(scenario, spec.name)) for spec in parameter_specs(Scenario)},
    }
    if scenario.node_parameters:
        content[_NODE_PARAMETERS] = {
            node: dict(given) for node, given in scenario.node_parameters.items()
        }
    if scenario.faults:
        content[_FAULTS] = plain_faults(scenario.faults)
    # JSON is YAML with every text in quotes; without them `1e3` would come back as a number.
    lines = [f"{key}: {json.dumps(value, ensure_ascii=False)}" for key, value in content.items()]
    return "\n".join(lines) + "\n"


def _find(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    names = shipped_scenarios()
    if text in names:
        return scenario_folder() / f"{text}.yaml"
    path = Path(text)
    try:
        if path.suffix in YAML_SUFFIXES or path.is_file():
            return path
    except OSError as error:  # the name is too long
        raise ScenarioError(f"scenario {shown(text)}: {error.strerror}") from None
    raise ScenarioError(
        f"scenario {text!r} is unknown; {suggestion(text, names)}, or the path of a .yaml file"
    )


def _checked(prefix: str, spec: ParameterSpec, value: object) -> Any:
    try:
        return checked_value(spec, value)
    except ParameterError as error:
        raise ScenarioError(f"{prefix}{error}") from None


def _typed(spec: ParameterSpec, text: str) -> Scalar:
    """Return a typed text as a number where the field is one; leave nonsense to the check."""
    if spec.kind is str:
        return text
    number = parse_yaml(text, f"option {spec.name}", ScenarioError)
    return number if isinstance(number, (int, float)) else text


def _rooted(key: str, value: Scalar, folder: Path) -> Scalar:
    """Let a relative file name start at the folder of the scenario."""
    if key in _FILE_OF and is_path(str(value), _FILE_OF[key]):
        return str(folder / str(value))
    return value


def _overrides_text(written: StrictMapping) -> Any:
    """Return overrides given as a mapping in the form of one line, as node parameters carry them."""
    if not isinstance(written.content[_OVERRIDES], Mapping):
        return written.content[_OVERRIDES]
    overrides = written.section(_OVERRIDES)
    for key in overrides:
        overrides.number(key)
    return ", ".join(f"{key}={number!r}" for key, number in overrides.content.items())


def _node_parameters(by_node: StrictMapping) -> dict[str, dict[str, Scalar]]:
    result: dict[str, dict[str, Scalar]] = {}
    for node in by_node:
        given = by_node.section(node, kind="parameter")
        result[node] = {name: given.scalar(name) for name in given}
    return result
