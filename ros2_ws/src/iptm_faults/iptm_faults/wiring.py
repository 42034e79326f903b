"""Names of the topics on both sides of the injector.

True values keep their names for recorders and viewers: the plant's topics, and `v2x/leader` and
`v2x/leader_preview` of the effective leader. The faulty inputs of controller and bridge have their own names,
to which these inputs are remapped, and so have the bridge's outputs for the leader of the route.
"""

from __future__ import annotations

_FAULTY = "faults/faulty/"
_ROUTE = "faults/route/"


def faulty_name(topic: str) -> str:
    """Return the name of a topic with faults applied, as its receiver subscribes to it."""
    return _FAULTY + topic.lstrip("/")


def route_name(topic: str) -> str:
    """Return the name under which the bridge publishes a topic of the route's leader."""
    return _ROUTE + topic.lstrip("/")
