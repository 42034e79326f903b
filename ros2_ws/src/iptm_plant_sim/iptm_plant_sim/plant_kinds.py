"""Which vehicle a trip drives: the simulated one, or one from a file that an extra drives."""

from __future__ import annotations

from pathlib import Path

from iptm_core.errors import ScenarioError
from iptm_core.extras import offered
from iptm_plant_sim.plant import Plant


def plant_kind(file: str) -> type[Plant]:
    """Return the kind of plant of a file; the simulated vehicle without one.

    The module ``extra_plants`` of an extra has a mapping ``KINDS`` of endings of files to functions that
    return it.

    Raises:
        ScenarioError: no installed extra drives such files, or this one cannot be used.
    """
    if not file:
        return Plant
    kinds = {end: of for extra in offered("plants") for end, of in extra.KINDS.items()}
    suffix = Path(file).suffix
    if suffix not in kinds:
        allowed = ", ".join(f"*{end}" for end in sorted(kinds)) or "none, as no extra drives any"
        raise ScenarioError(f"plant is {file!r}; allowed: {allowed}")
    kind: type[Plant] = kinds[suffix](file)
    return kind


def plant_topics(file: str) -> dict[str, str]:
    """Return the topics that extras add to a plant from a file: message types by topic name.

    The module ``extra_plant_topics`` of an extra has them as the mapping ``TYPES``, and the ending of its
    files as ``SUFFIX``.
    """
    if not file:
        return {}
    added = (each.TYPES for each in offered("plant_topics") if Path(file).suffix == each.SUFFIX)
    return {name: kind for types in added for name, kind in types.items()}
