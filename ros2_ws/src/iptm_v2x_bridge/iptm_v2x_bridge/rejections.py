"""Reasons to reject a datagram or a message; rejections are counted."""

from __future__ import annotations

from collections import Counter

from iptm_core.declaration import TextEnum


class Rejection(TextEnum):
    """Reasons in the order in which they are looked for."""

    SIZE = "size"
    """Empty, or longer than any message of this kind."""
    SECURED = "secured"
    """A secured packet whose envelope is malformed, encrypted, or holds no data."""
    PACKET = "packet"
    """Neither a message nor a single-hop broadcast around one, or lengths that do not fit."""
    PORT = "port"
    """Another service than those that are read."""
    HEADER = "header"
    """Another protocol version or message."""
    UNVERIFIED = "unverified"
    """Not signed, or signed in a way that cannot be verified, where signatures are asked for."""
    UNKNOWN_SIGNER = "unknown_signer"
    """Signed by a station whose certificate has not been heard, or that no trust anchor vouches for."""
    SIGNATURE = "signature"
    """The signature of the message or of a certificate is wrong."""
    EXPIRED = "expired"
    """A certificate does not hold yet or any more."""
    NOT_PERMITTED = "not_permitted"
    """The certificate is not one for messages of this kind."""
    DECODING = "decoding"
    """The bits are not a message."""
    CONSTRAINT = "constraint"
    """A value outside the range of the standard."""
    INCOMPLETE = "incomplete"
    """Not a vehicle, or no position, speed or heading of a moving one; phases without time, lanes without
    place."""
    ABSURD = "absurd"
    """A speed or acceleration that no road vehicle has."""
    TIMESTAMPS = "timestamps"
    """The times of packet and message contradict each other: an old message in a new packet."""
    FUTURE = "future"
    """Generated later than now, or than the clock of the station allows."""
    STALE = "stale"
    """Generated too long ago."""
    DUPLICATE = "duplicate"
    """Generated at the same instant as the last message of the station."""
    OLDER = "older"
    """Generated before the last message of the station: overtaken on the way, or replayed."""
    CONTRADICTION = "contradiction"
    """Contradicts other messages of the station: two senders with one identity."""
    POSITION_JUMP = "position_jump"
    """The station cannot have moved that far."""
    LATERAL_JUMP = "lateral_jump"
    """The station cannot have moved sideways that far."""
    SPEED_JUMP = "speed_jump"
    """The station cannot have changed its speed that much."""
    HEADING_JUMP = "heading_jump"
    """The station cannot have turned that far."""
    PHASE_JUMP = "phase_jump"
    """A signal opens before the announced earliest end of its closed phase."""
    OTHER_MAP = "other_map"
    """Other lanes of the same intersection under the same revision."""
    TABLE_FULL = "table_full"
    """Forgotten to make room for another station."""
    OVERFLOW = "overflow"
    """Arrived faster than it could be read."""
    WAITED = "waited"
    """Of a roadside station, and dropped while others were decoded."""


class LeftOut(TextEnum):
    """Parts of a message that are not read while the rest of it counts."""

    COMPUTED_LANE = "computed_lane"
    """A lane described by another one."""
    REGIONAL_NODE = "regional_node"
    """A lane with a node of a regional form."""


class RejectionCounts:
    """How often each reason occurred."""

    def __init__(self) -> None:
        self._counts: Counter[Rejection] = Counter()

    def add(self, reason: Rejection, times: int = 1) -> None:
        """Count a reason."""
        self._counts[reason] += times

    def __add__(self, other: RejectionCounts) -> RejectionCounts:
        """Return the counts of both."""
        found = RejectionCounts()
        found._counts = self._counts + other._counts
        return found

    def __getitem__(self, reason: Rejection) -> int:
        """Return the count of one reason."""
        return self._counts[reason]

    @property
    def total(self) -> int:
        """All of them."""
        return self._counts.total()

    def by_reason(self) -> dict[str, int]:
        """Return the counts above zero, by reason."""
        return {str(reason): self._counts[reason] for reason in Rejection if self._counts[reason]}
