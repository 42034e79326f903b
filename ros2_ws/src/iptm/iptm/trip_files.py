"""Trips as YAML text, from files and command lines; unknown keys are errors.

    description: WLTC class 3b on hills, an unreliable radio link
    road: {slope: small}
    leader: {dropout_probability: 0.2}
    vehicle: {overrides: {body.mass_kg: 1600}}
    conditions:
      faults: [{kind: leader_hard_stop, start_s: 120, duration_s: 10, size: 8}]

What a file does not state keeps its default. Relative paths in a file start at its own folder.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from iptm.faults.fault import faults_from, plain_faults
from iptm.trip import Trip
from iptm.trip_settings import GROUPS, HOME, SPECS
from iptm_core.declaration import Scalar, checked_value, plain
from iptm_core.errors import ParameterError, ScenarioError
from iptm_core.parameters.strict_yaml import YAML_SUFFIXES, parse_yaml, read_yaml
from iptm_core.routes.cycles import CYCLE_NAMES
from iptm_core.routes.route import GPX_SUFFIX, USER_SUFFIXES
from iptm_core.user_input import StrictMapping, check_known, is_path, shown, suggestion

DEFAULT_TRIP = "wltc"
LONGEST_NAME = 100
"""Characters of the name of a trip, which become a part of file names."""
_DESCRIPTION, _FAULTS = "description", "faults"
_FILE_OF = {"cycle": USER_SUFFIXES, "slope": (GPX_SUFFIX,), "parameter_set": YAML_SUFFIXES}
"""Settings that may name a file, and by which suffixes that is seen."""


GIVEN_UP = {
    "charging_minute_kwh": 0.0,
    "charging_power_kw": 150.0,
    "charging_heater_kw": 0.0,
    "fast_charge_from": 0.1,
    "fast_charge_to": 0.8,
    "compile_code": True,
}
"""Settings of earlier versions: a bag or file that states their defaults stays readable."""


def trip_folder() -> Path:
    """Return the folder of the shipped trips."""
    return Path(__file__).parent / "trips"


def shipped_trips() -> tuple[str, ...]:
    """Return the names of the shipped trips, the default first."""
    names = [path.stem for path in trip_folder().glob("*.yaml")]
    return tuple(sorted(names, key=lambda name: (name != DEFAULT_TRIP, name)))


def load_trip(
    name_or_path: str | Path = DEFAULT_TRIP, options: Mapping[str, str] | None = None
) -> Trip:
    """Read a trip and lay options over it.

    Args:
        name_or_path: name of a shipped trip, or the path of a YAML file.
        options: texts by name of the setting, as typed on a command line.

    Raises:
        ScenarioError: no such trip, a malformed file, an unknown key, a wrong type or range; the message
            names file or option, key, value and the allowed ones.
    """
    path = _find(name_or_path)
    content = read_yaml(path, ScenarioError)
    return trip_from(content, str(path), path.stem, path.parent, options)


def trip_from(
    content: Any,
    origin: str,
    name: str,
    folder: Path,
    options: Mapping[str, str] | None = None,
) -> Trip:
    """Build a trip from the content of a file and options; see `load_trip`.

    Args:
        content: what the YAML file holds.
        origin: what to call the file in a message.
        name: name of the trip; the default one is named after a cycle among the options.
        folder: where relative paths start.
        options: texts by name of the setting.
    """
    if isinstance(content, Mapping):
        content = {group: still_known(section) for group, section in content.items()}
    written = StrictMapping({} if content is None else content, origin, [_DESCRIPTION, *GROUPS])
    values: dict[str, Any] = {"name": name, "description": written.text(_DESCRIPTION, "")}
    for group in GROUPS:
        section = written.section(group, [name for name, home in HOME.items() if home == group])
        for key, value in section.content.items():
            values[key] = _rooted(key, _checked(f"{section.where}: ", key, value), folder)
    for key, text in (options or {}).items():
        check_known(key, HOME, "option --set", "setting", ScenarioError)
        values[key] = _checked("option ", key, _typed(key, text), f"{HOME[key]}.{key}")
    if name == DEFAULT_TRIP and "cycle" in (options or {}):
        values["name"] = _name_of(str(values["cycle"]))
    try:
        return Trip().changed(**values)
    except ParameterError as error:
        raise ScenarioError(f"trip {name}: {error}") from None


def still_known(section: Any) -> Any:
    """Return the settings of a section, except the ones of `GIVEN_UP` at their defaults."""
    if not isinstance(section, Mapping):
        return section
    return {
        key: value
        for key, value in section.items()
        if key not in GIVEN_UP or value != GIVEN_UP[key]
    }


def assigned(assignments: Iterable[str]) -> dict[str, str]:
    """Return texts by name of the setting from assignments ``group.name=value``.

    Raises:
        ScenarioError: an assignment is not of this form, or names no setting of the group.
    """
    options: dict[str, str] = {}
    for assignment in assignments:
        key, separator, text = assignment.partition("=")
        group, dot, name = key.strip().partition(".")
        if not (separator and dot and name):
            raise ScenarioError(
                f"option --set is {assignment!r}; allowed: <group>.<setting>=<value>, "
                f"with a group of {', '.join(GROUPS)}"
            )
        check_known(group, GROUPS, "option --set", "group", ScenarioError)
        names = [each for each, home in HOME.items() if home == group]
        check_known(name, names, f"option --set: {group}", "setting", ScenarioError)
        options[name] = text
    return options


def trip_text(trip: Trip) -> str:
    """Return a trip as the YAML text that `trip_from` reads back.

    Raises:
        ScenarioError: the leader drives what is in no file.
    """
    if trip.own_drive is not None:
        raise ScenarioError(
            f"cycle is {trip.road.cycle}, a drive given as data; allowed here: a name or the path of a drive"
        )
    lines = [f"{_DESCRIPTION}: {_text(trip.description)}"]
    for group in GROUPS:
        settings = getattr(trip, group)
        lines.append(f"{group}:")
        names = [entry.name for entry in fields(settings) if HOME.get(entry.name) == group]
        names = [name for name in names if name in SPECS]
        lines += [f"  {name}: {_text(plain(getattr(settings, name)))}" for name in names]
    if trip.conditions.faults:
        lines.append(f"  {_FAULTS}: {_text(plain_faults(trip.conditions.faults))}")
    return "\n".join(lines) + "\n"


def _text(value: Any) -> str:
    # JSON is YAML with every text in quotes; without them `1e3` would come back as a number.
    return json.dumps(value, ensure_ascii=False)


def _name_of(cycle: str) -> str:
    """Return the name of a cycle without folder and suffix, as far as it fits into the name of a folder."""
    stem = Path(cycle.partition("#")[0]).stem
    return re.sub(r"[^\w.-]+", "_", stem)[:LONGEST_NAME] or DEFAULT_TRIP


def _find(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    names = shipped_trips()
    if text in names:
        return trip_folder() / f"{text}.yaml"
    path = Path(text)
    try:
        if path.suffix in YAML_SUFFIXES or path.is_file():
            return path
    except OSError as error:  # the name is too long
        raise ScenarioError(f"trip {shown(text)}: {error.strerror}") from None
    cycle = f"--cycle {text}, " if text in CYCLE_NAMES else ""
    raise ScenarioError(
        f"trip {text!r} is unknown; {cycle}{suggestion(text, names)}, or the path of a .yaml file"
    )


def _checked(prefix: str, key: str, value: object, name: str = "") -> Any:
    """Return a value in the type of its setting; overrides may be a mapping, and faults are a list."""
    if key == _FAULTS:
        return faults_from(value, prefix.rstrip(": "))
    if SPECS[key].name.endswith("overrides") and isinstance(value, Mapping):
        overrides = StrictMapping(value, f"{prefix}{key}")
        return {each: overrides.number(each) for each in overrides}
    try:
        return checked_value(replace(SPECS[key], name=name or key), value)
    except ParameterError as error:
        raise ScenarioError(f"{prefix}{error}") from None


def _typed(key: str, text: str) -> Any:
    """Return a typed text as a number or a list where the setting is one; leave nonsense to the check."""
    if key != _FAULTS and SPECS[key].kind is str:
        return text
    found = parse_yaml(text, f"option {key}", ScenarioError)
    return found if key == _FAULTS or isinstance(found, (int, float)) or found is None else text


def _rooted(key: str, value: Scalar, folder: Path) -> Scalar:
    """Let a relative file name start at the folder of the trip's file."""
    if key in _FILE_OF and is_path(str(value), _FILE_OF[key]):
        return str(folder / str(value))
    return value
