"""Names of the topics that the injector comes between.

What is true keeps its name, for whoever records or watches: the plant's topics, and `v2x/leader` and
`v2x/leader_preview` of the leader that counts. What controller and bridge are told has names of its own, to
which their inputs are remapped; so have the leader of the route and its predictions, the bridge's outputs.
"""

from __future__ import annotations

_TOLD = "faults/told/"
_ROUTE = "faults/route/"


def told_name(topic: str) -> str:
    """Return the name under which a receiver is told what faults make of a topic."""
    return _TOLD + topic.lstrip("/")


def route_name(topic: str) -> str:
    """Return the name under which the bridge tells the leader of the route."""
    return _ROUTE + topic.lstrip("/")
