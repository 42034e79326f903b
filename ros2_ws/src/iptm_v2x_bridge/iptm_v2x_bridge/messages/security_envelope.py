"""The security envelope of TS 103 097 around a packet: what is signed, taken out without a verification.

Cars on the road sign every message. An envelope is Ieee1609Dot2Data in canonical octet encoding rules
(IEEE 1609.2): version, the choice of signed data, hash algorithm, the payload with data and no external hash,
inside of it version, the choice of unsecured data, and the octets. Header information, signer and signature
follow and are not looked at: a message read this way is as trustworthy as one that is not signed.
"""

from __future__ import annotations

_VERSION = 3
_SIGNED_DATA, _UNSECURED_DATA = 0x81, 0x80
_HASH_ALGORITHMS = (0, 1)
_DATA_ONLY = 0x40
_SHORT_LENGTH = 0x80
_LONGEST_LENGTH = 2
"""Octets of a length; an envelope fits into a datagram."""


def signed_octets(envelope: bytes) -> bytes | None:
    """Return the octets that an envelope signs, None for anything but an envelope around data.

    Args:
        envelope: from the version on, with anything behind the octets.
    """
    head = envelope[:6]
    if len(head) < 6 or head[2] not in _HASH_ALGORITHMS:
        return None
    if head != bytes((_VERSION, _SIGNED_DATA, head[2], _DATA_ONLY, _VERSION, _UNSECURED_DATA)):
        return None
    found = _length(envelope[6:])
    if found is None:
        return None
    start, length = 6 + found[0], found[1]
    # A signer and a signature have to follow.
    return envelope[start : start + length] if start + length < len(envelope) else None


def _length(octets: bytes) -> tuple[int, int] | None:
    """Return the number of octets that state a length, and the length; None where it is malformed."""
    if not octets:
        return None
    if octets[0] < _SHORT_LENGTH:
        return 1, octets[0]
    count = octets[0] - _SHORT_LENGTH
    if not 1 <= count <= _LONGEST_LENGTH or len(octets) <= count:
        return None
    return 1 + count, int.from_bytes(octets[1 : 1 + count], "big")
