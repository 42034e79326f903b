"""The security envelope of TS 103 097 around a packet: signed content and signer.

Cars on the road sign every message. An envelope is Ieee1609Dot2Data in canonical octet encoding rules
(IEEE 1609.2): version, the choice of signed data, hash algorithm, the payload with data and no external hash,
inside of it version, the choice of unsecured data, and the octets. Header information, signer and signature
follow. Octets that are taken out without them are as trustworthy as those that are not signed.
"""

from __future__ import annotations

from dataclasses import dataclass

from iptm_v2x_bridge.messages.certificate import (
    VERSION,
    Certificate,
    Octets,
    Signature,
    UnreadableError,
    skip_encryption_key,
    take_certificate,
    take_signature,
)

_SIGNED_DATA, _UNSECURED_DATA, _DATA_ONLY = 0x81, 0x80, 0x40
_HASH_ALGORITHMS = 2
_DIGEST, _CERTIFICATES = 0x80, 0x81


@dataclass(frozen=True)
class SignedMessage:
    """What surrounds the octets that a station signs.

    Attributes:
        signed: what is signed, octets and header.
        service: PSID in the header.
        generated_us: TimestampIts of the header in us, None without one.
        signer: certificates, the signer's first; or the digest of its certificate.
        signature: of the signer.
    """

    signed: bytes
    service: int
    generated_us: int | None
    signer: tuple[Certificate, ...] | bytes
    signature: Signature


def signed_octets(envelope: bytes) -> bytes | None:
    """Return the octets that an envelope signs, None for anything but an envelope around data.

    Args:
        envelope: from the version on, with anything behind the octets.
    """
    octets = Octets(envelope)
    try:
        found = _data(octets)
        octets.number()  # a signer and a signature have to follow
    except UnreadableError:
        return None
    return found


def _data(octets: Octets) -> bytes:
    octets.expect(VERSION, _SIGNED_DATA)
    if octets.number() >= _HASH_ALGORITHMS:
        raise UnreadableError
    octets.expect(_DATA_ONLY, VERSION, _UNSECURED_DATA)
    return octets.string()


def read_signed_message(envelope: bytes) -> SignedMessage:
    """Read signed data with its signer.

    Raises:
        UnreadableError: it is none, or is signed in a way that is not read.
    """
    octets = Octets(envelope)
    _data(octets)
    service, generated_us = _header(octets)
    signed = envelope[3 : octets.at]  # behind version, choice and hash algorithm
    choice = octets.number()
    signer: tuple[Certificate, ...] | bytes
    if choice == _DIGEST:
        signer = octets.take(8)
    elif choice == _CERTIFICATES:
        signer = tuple(take_certificate(octets) for _ in octets.entries())
    else:
        raise UnreadableError
    signature, _ = take_signature(octets)
    if not signer:
        raise UnreadableError
    return SignedMessage(signed, service, generated_us, signer, signature)


def _header(octets: Octets) -> tuple[int, int | None]:
    present = octets.number()
    service = octets.integer()
    generated_us = octets.number(8) if present & 0x40 else None
    for bit, count in ((0x20, 8), (0x10, 10), (0x08, 3), (0x04, 6)):
        octets.take(count if present & bit else 0)
    if present & 0x02:
        octets.expect(0x80)  # a public key
        skip_encryption_key(octets)
    if present & 0x80:
        octets.skip_additions()
    return service, generated_us
