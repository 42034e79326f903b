"""Shorthand for lists of run addresses: ``horizon/{5,10}`` stands for ``horizon/5`` and ``horizon/10``."""

from __future__ import annotations

import re
from collections.abc import Iterable

from iptm_core.errors import ScenarioError

_BRACES = re.compile(r"\{([^{}]*)\}")


def expanded(address: str, origin: str) -> list[str]:
    """Write out one address.

    Args:
        address: an address with any number of brace groups; the last group varies fastest.
        origin: where it was written, for the message.

    Returns:
        All addresses that it stands for.

    Raises:
        ScenarioError: braces that do not match, or an empty alternative.
    """
    found = _BRACES.search(address)
    if found is None:
        if "{" in address or "}" in address:
            raise ScenarioError(f"{origin}: address '{address}': braces that do not match")
        return [address]
    parts = [part.strip() for part in found[1].split(",")]
    if not all(parts):
        raise ScenarioError(f"{origin}: address '{address}': an empty alternative in braces")
    before, after = address[: found.start()], address[found.end() :]
    return [whole for part in parts for whole in expanded(f"{before}{part}{after}", origin)]


def expanded_all(addresses: Iterable[str], origin: str) -> tuple[str, ...]:
    """Write out a list of addresses.

    Raises:
        ScenarioError: see `expanded`; or an address occurs twice.
    """
    whole = [single for address in addresses for single in expanded(address, origin)]
    twice = sorted({address for address in whole if whole.count(address) > 1})
    if twice:
        raise ScenarioError(f"{origin}: {', '.join(twice)} occurs twice")
    return tuple(whole)
