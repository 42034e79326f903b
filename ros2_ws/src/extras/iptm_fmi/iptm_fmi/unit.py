"""A unit: the content of an FMU, independent of the version of FMI."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from iptm_core.c_sources import CSources

C_SOURCES = CSources(
    Path(__file__).resolve().parent / "c",
    {
        "descent": ("iptm_controller.lead_check", "iptm_core.braking"),
        "plant": (
            "iptm_controller.ladder",
            "iptm_core.physics.cell",
            "iptm_plant_sim.actuators",
            "iptm_plant_sim.integrator",
        ),
        "unit": ("iptm_core.state",),
    },
)
TICK_S = 1.0
"""Sampling time of a controller, and the step that descriptions suggest."""
ROAD_ROOM = 64
"""Nodes of the road ahead."""
LARGEST = 1e12


class Kind(Enum):
    """What may be done with a variable; the value is its name in C."""

    OUTPUT = "IPTM_OUTPUT"
    INPUT = "IPTM_INPUT"
    START = "IPTM_START"
    """An output that can be set until the initialization ends."""
    PARAMETER = "IPTM_PARAMETER"


@dataclass(frozen=True)
class Variable:
    """A variable of real values.

    Attributes:
        symbol: end of its name in C, ``V_SYMBOL``; that of its name without the unit by default.
        start: before the first step.
        least: smallest value that is taken; not finite ones never are.
        size: number of values; None for one that is no array.
    """

    name: str
    kind: Kind
    unit: str
    text: str
    start: float = 0.0
    least: float = -LARGEST
    most: float = LARGEST
    size: int | None = None

    @property
    def count(self) -> int:
        """Number of values."""
        return 1 if self.size is None else self.size


@dataclass(frozen=True)
class Unit:
    """What an FMU is made of.

    Attributes:
        name: identifier of the model.
        sources: C files of the model by name.
        aliases: further names in C of places of values, by name of the variable.
        longest_step_s: longest step that is taken.
    """

    name: str
    text: str
    variables: Sequence[Variable]
    sources: Mapping[str, str]
    longest_step_s: float
    aliases: Mapping[str, str] = field(default_factory=dict)

    @property
    def places(self) -> list[int]:
        """Place of the first value of each variable."""
        counts = [variable.count for variable in self.variables]
        return [sum(counts[:index]) for index in range(len(counts))]

    @property
    def value_count(self) -> int:
        """Number of values of all variables; the place of the time in FMI 3.0."""
        return sum(variable.count for variable in self.variables)

    @property
    def token(self) -> str:
        """What tells this unit from any other: of its variables and its code."""
        digest = hashlib.sha256(repr((self.name, self.variables)).encode())
        for name, text in sorted(self.sources.items()):
            digest.update(f"{name}\0{text}\0".encode())
        code = digest.hexdigest()
        return f"{{{code[:8]}-{code[8:12]}-{code[12:16]}-{code[16:20]}-{code[20:32]}}}"

    def files(self, version: int) -> dict[str, str]:
        """Return all C files but the headers of FMI, by name."""
        names = ["unit.c", "unit.h", f"fmi{version}.c"]
        names += ["fmi3_unused.c"] if version == 3 else []
        header, table = self._declarations()
        return {
            **C_SOURCES.read(*names),
            **self.sources,
            "unit_variables.h": header,
            "unit_variables.c": table,
        }

    def _declarations(self) -> tuple[str, str]:
        places = dict(zip((each.name for each in self.variables), self.places, strict=True))
        named = {name.upper(): place for name, place in places.items()}
        named |= {alias: places[name] for alias, name in self.aliases.items()}
        symbols = "".join(f"#define V_{name} {place}\n" for name, place in named.items())
        header = (
            "#ifndef IPTM_UNIT_VARIABLES_H\n#define IPTM_UNIT_VARIABLES_H\n"
            f'#define IPTM_TOKEN "{self.token}"\n'
            f"#define IPTM_UNIT_VARIABLES {len(self.variables)}\n"
            f"#define IPTM_UNIT_VALUES {self.value_count}\n"
            f"#define IPTM_LONGEST_STEP_S {self.longest_step_s!r}\n{symbols}#endif\n"
        )
        rows = ",\n".join(
            f"  {{{place}, {each.count}, {each.kind.value}, {literal(each.least)}, {literal(each.most)},"
            f' "{each.name}"}}'
            for each, place in zip(self.variables, self.places, strict=True)
        )
        starts = ", ".join(
            literal(each.start) for each in self.variables for _ in range(each.count)
        )
        table = (
            f'#include "unit.h"\n\nconst iptm_variable iptm_variables[IPTM_UNIT_VARIABLES] = {{\n{rows}}};\n'
            f"const double iptm_starts[IPTM_UNIT_VALUES] = {{{starts}}};\n"
        )
        return header, table


def literal(value: float) -> str:
    """Return a number as C reads it, to the last bit."""
    if not math.isfinite(value):
        raise AssertionError(f"{value} has no literal in C")
    return repr(float(value))


def road_variables() -> list[Variable]:
    """Return the inputs of a road: nodes of position and slope, and how many of them count."""
    return [
        Variable(
            "road_nodes", Kind.INPUT, "1", "nodes of the road that count", 0.0, 0.0, ROAD_ROOM
        ),
        Variable(
            "road_position",
            Kind.INPUT,
            "m",
            "increasing positions of the nodes along the road, from 25 m behind the vehicle on",
            size=ROAD_ROOM,
        ),
        Variable(
            "road_slope",
            Kind.INPUT,
            "rad",
            "slope at the nodes, positive uphill; linear between them, the ends held",
            0.0,
            -0.5,
            0.5,
            ROAD_ROOM,
        ),
    ]
