"""Single parameter changes written as one line of text, as node parameters and options carry them."""

from __future__ import annotations

from iptm_core.errors import ParameterError


def parse_overrides(text: str) -> dict[str, float]:
    """Read ``key=value`` pairs separated by commas, such as ``body.mass_kg=1600, gap.max_gap_m=80``.

    Args:
        text: the pairs; empty for none. Whether the keys exist is checked by ``load_parameters``.

    Raises:
        ParameterError: an entry is no such pair or a key appears twice.
    """
    overrides: dict[str, float] = {}
    for entry in filter(None, (part.strip() for part in text.split(","))):
        key, separator, value = (part.strip() for part in entry.partition("="))
        try:
            number = float(value)
        except ValueError:
            separator = ""
        if not separator or not key or key in overrides:
            raise ParameterError(
                f"parameter overrides have the entry {entry!r}; allowed: "
                "different entries key=number, separated by commas"
            )
        overrides[key] = number
    return overrides
