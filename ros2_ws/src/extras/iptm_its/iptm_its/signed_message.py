"""What surrounds the octets that a station signs: header, signer and signature (IEEE 1609.2, TS 103 097)."""

from __future__ import annotations

from dataclasses import dataclass

from iptm_its.certificate import (
    Certificate,
    Signature,
    skip_encryption_key,
    take_certificate,
    take_signature,
)
from iptm_v2x_bridge.messages.octets import Octets, UnreadableError
from iptm_v2x_bridge.messages.packets import take_data

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


def read_signed_message(envelope: bytes) -> SignedMessage:
    """Read signed data with its signer.

    Raises:
        UnreadableError: it is none, or is signed in a way that is not read.
    """
    octets = Octets(envelope)
    take_data(octets)
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
