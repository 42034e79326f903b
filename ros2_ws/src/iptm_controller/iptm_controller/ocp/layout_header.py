"""The layout of the flat vectors for C: ``layout.h``, made from the indices in Python."""

from __future__ import annotations

from iptm_controller.ocp import layout
from iptm_core.state import FloatArray

_INDICES = {
    "STATE": layout.StateIndex,
    "INPUT": layout.InputIndex,
    "GLOBAL": layout.GlobalIndex,
    "STEP": layout.StepIndex,
    "SAMPLE": layout.SampleIndex,
}


def layout_header() -> str:
    """Return the sizes of a stage, the places in its vectors, and its scales."""
    sizes = {
        "STATES": layout.STATES,
        "INPUTS": layout.INPUTS,
        "SLACKS": layout.SLACKS,
        "GLOBALS": layout.GLOBALS,
        "WEIGHTS": len(layout.WEIGHTS),
        "SAMPLE_PARAMETERS": layout.SAMPLE_PARAMETERS,
    }
    places = {
        f"{prefix}_{entry.name}": int(entry) for prefix, kind in _INDICES.items() for entry in kind
    }
    places |= {f"GLOBAL_{name.upper()}": place for name, place in layout.WEIGHTS.items()}
    scales = {
        "STATE_SCALE": layout.STATE_SCALE,
        "STATE_OFFSET": layout.STATE_OFFSET,
        "INPUT_SCALE": layout.INPUT_SCALE,
    }
    lines = [f"#define IPTM_{name} {value}" for name, value in (sizes | places).items()]
    lines += [f"#define IPTM_{name} {_braced(values)}" for name, values in scales.items()]
    return "\n".join(["#ifndef IPTM_LAYOUT_H", "#define IPTM_LAYOUT_H", *lines, "#endif", ""])


def _braced(values: FloatArray) -> str:
    return "{" + ", ".join(map(repr, values.tolist())) + "}"
