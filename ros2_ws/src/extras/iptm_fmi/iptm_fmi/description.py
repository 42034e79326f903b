"""The description of a unit that an FMU carries: ``modelDescription.xml`` of FMI 2.0 and 3.0."""

from __future__ import annotations

from collections.abc import Iterator
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from iptm_fmi.unit import TICK_S, Kind, Unit, Variable

_BASE_UNITS = {
    "1": {},
    "m": {"m": 1},
    "s": {"s": 1},
    "1/s": {"s": -1},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad": {"rad": 1},
    "K": {"K": 1},
    "A": {"A": 1},
    "C": {"A": 1, "s": 1},
    "J": {"kg": 1, "m": 2, "s": -2},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "W": {"kg": 1, "m": 2, "s": -3},
}
_CAUSALITIES = {
    Kind.OUTPUT: "output",
    Kind.START: "output",
    Kind.INPUT: "input",
    Kind.PARAMETER: "parameter",
}
TOOL = "iptm"


def description(unit: Unit, version: int) -> str:
    """Return the description of a unit for a version of FMI, 2 or 3."""
    root = _description_2(unit) if version == 2 else _description_3(unit)
    indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def _description_2(unit: Unit) -> Element:
    root = Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=unit.name,
        guid=unit.token,
        description=unit.text,
        generationTool=TOOL,
        variableNamingConvention="structured",
    )
    simulation = SubElement(
        root,
        "CoSimulation",
        modelIdentifier=unit.name,
        canHandleVariableCommunicationStepSize="true",
        canNotUseMemoryManagementFunctions="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
    )
    sources = SubElement(simulation, "SourceFiles")
    for name in source_names(unit, 2):
        SubElement(sources, "File", name=name)
    _add_units(root, unit)
    SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(TICK_S))
    variables = SubElement(root, "ModelVariables")
    outputs, unknowns = [], []
    for index, (name, place, each) in enumerate(_scalars(unit), start=1):
        entry = SubElement(
            variables,
            "ScalarVariable",
            {"name": name, "valueReference": str(place), "description": each.text, **_roles(each)},
        )
        SubElement(entry, "Real", _values(each, repr(each.start)))
        if _CAUSALITIES[each.kind] == "output":
            outputs.append(index)
        if each.kind is Kind.OUTPUT:
            unknowns.append(index)
    structure = SubElement(root, "ModelStructure")
    for part, indices in (("Outputs", outputs), ("InitialUnknowns", unknowns)):
        if indices:
            listed = SubElement(structure, part)
            for index in indices:
                SubElement(listed, "Unknown", index=str(index))
    return root


def _description_3(unit: Unit) -> Element:
    root = Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=unit.name,
        instantiationToken=unit.token,
        description=unit.text,
        generationTool=TOOL,
        variableNamingConvention="structured",
    )
    SubElement(
        root,
        "CoSimulation",
        modelIdentifier=unit.name,
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )
    _add_units(root, unit)
    SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(TICK_S))
    variables, structure = SubElement(root, "ModelVariables"), Element("ModelStructure")
    SubElement(
        variables,
        "Float64",
        name="time",
        valueReference=str(unit.value_count),
        causality="independent",
        variability="continuous",
        unit="s",
    )
    unknowns = []
    for each, place in zip(unit.variables, unit.places, strict=True):
        start = " ".join([repr(each.start)] * each.count)
        entry = SubElement(
            variables,
            "Float64",
            {
                "name": each.name,
                "valueReference": str(place),
                "description": each.text,
                **_roles(each),
                **_values(each, start),
            },
        )
        if each.size is not None:
            SubElement(entry, "Dimension", start=str(each.size))
        if _CAUSALITIES[each.kind] == "output":
            SubElement(structure, "Output", valueReference=str(place))
        if each.kind is Kind.OUTPUT:
            unknowns.append(str(place))
    for reference in unknowns:
        SubElement(structure, "InitialUnknown", valueReference=reference)
    root.append(structure)
    return root


def build_description(unit: Unit) -> str:
    """Return ``sources/buildDescription.xml`` of FMI 3.0."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=unit.name)
    sources = SubElement(
        configuration,
        "SourceFileSet",
        language="C99",
        compiler="gcc",
        compilerOptions="-ffp-contract=off",
    )
    for name in source_names(unit, 3):
        SubElement(sources, "SourceFile", name=name)
    SubElement(configuration, "Library", name="m")
    indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def source_names(unit: Unit, version: int) -> list[str]:
    """Return the names of the C files that are compiled."""
    return sorted(name for name in unit.files(version) if name.endswith(".c"))


def _scalars(unit: Unit) -> Iterator[tuple[str, int, Variable]]:
    """Yield name, place and variable of every value."""
    for each, first in zip(unit.variables, unit.places, strict=True):
        if each.size is None:
            yield each.name, first, each
        else:
            for index in range(each.size):
                yield f"{each.name}[{index + 1}]", first + index, each


def _roles(variable: Variable) -> dict[str, str]:
    roles = {
        "causality": _CAUSALITIES[variable.kind],
        "variability": "fixed" if variable.kind is Kind.PARAMETER else "continuous",
    }
    if variable.kind is not Kind.INPUT:
        roles["initial"] = "calculated" if variable.kind is Kind.OUTPUT else "exact"
    return roles


def _values(variable: Variable, start: str) -> dict[str, str]:
    if variable.kind is Kind.OUTPUT:
        return {"unit": variable.unit}
    bounds = {"min": repr(variable.least), "max": repr(variable.most)}
    return {"unit": variable.unit, **bounds, "start": start}


def _add_units(root: Element, unit: Unit) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(["s", *(variable.unit for variable in unit.variables)]):
        base = {key: str(power) for key, power in _BASE_UNITS[name].items()}
        SubElement(SubElement(definitions, "Unit", name=name), "BaseUnit", base)
