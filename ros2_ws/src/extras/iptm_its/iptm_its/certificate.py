"""Certificates of IEEE 1609.2 as TS 103 097 uses them: what verification needs, from their octets.

The canonical octet encoding rules (ITU-T X.696) are read by hand, because signatures are about octets and not
about values. Parts that verification does not need are skipped, such as regions and linkage data. Service
specific permissions are not compared, only the services (PSID).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from hashlib import sha256, sha384

from iptm_v2x_bridge.messages.octets import VERSION, Octets, UnreadableError

_X_ONLY, _EVEN_Y, _ODD_Y, _BOTH = 0x80, 0x82, 0x83, 0x84


class EllipticCurve(Enum):
    """An elliptic curve: the octets of a coordinate, and also of its hash."""

    NIST_P256 = (0x80, 32)
    BRAINPOOL_P256 = (0x81, 32)
    BRAINPOOL_P384 = (0x82, 48)

    @property
    def octets(self) -> int:
        """Octets of a coordinate."""
        return int(self.value[1])


@dataclass(frozen=True)
class PublicKey:
    """A point in the encoding of SEC 1: compressed (02 or 03, x) or uncompressed (04, x, y)."""

    curve: EllipticCurve
    point: bytes


@dataclass(frozen=True)
class Signature:
    """r and s of ECDSA, as octets."""

    curve: EllipticCurve
    r: bytes
    s: bytes


@dataclass(frozen=True)
class Certificate:
    """A certificate.

    Attributes:
        octets: all of it; the octets of r in its signature without the sign of y, as its digest takes them.
        signed: the part that its issuer signs.
        issuer: digest of the certificate of the issuer, None where it is the certificate itself.
        starts_s: begin of its validity, s of TimestampIts.
        ends_s: end of its validity.
        services: whose messages it may sign (PSID).
        issues: services whose certificates it may sign; None for all.
        key: key of its signatures, None in an implicit certificate.
        signature: of its issuer, None in an implicit certificate.
    """

    octets: bytes
    signed: bytes
    issuer: bytes | None
    starts_s: int
    ends_s: int
    services: frozenset[int]
    issues: frozenset[int] | None
    key: PublicKey | None
    signature: Signature | None

    @property
    def digest(self) -> bytes:
        """HashedId8: the last eight octets of the hash that belongs to the key."""
        function = sha384 if self.key and self.key.curve is EllipticCurve.BRAINPOOL_P384 else sha256
        return function(self.octets).digest()[-8:]


def read_certificate(octets: bytes) -> Certificate:
    """Read one certificate.

    Raises:
        UnreadableError: it is none, or something follows it.
    """
    reader = Octets(octets)
    found = take_certificate(reader)
    if reader.at != len(octets):
        raise UnreadableError
    return found


def take_certificate(octets: Octets) -> Certificate:
    """Read the next certificate."""
    start = octets.at
    has_signature = octets.number()
    octets.expect(VERSION)
    is_implicit = octets.number()
    choice = octets.number()
    issuer = None
    if choice == 0x81:
        octets.number()  # signs itself, with this hash
    else:
        issuer = octets.take(8) if choice == 0x80 else octets.string()
    signed_from = octets.at
    starts_s, ends_s, services, issues, key = _content(octets)
    signed = octets.octets[signed_from : octets.at]
    if not has_signature or is_implicit or key is None:
        whole, key, signature = octets.octets[start : octets.at], None, None
    else:
        signature, r_at = take_signature(octets)
        whole = octets.octets[start:r_at] + bytes((_X_ONLY,)) + octets.octets[r_at + 1 : octets.at]
    return Certificate(whole, signed, issuer, starts_s, ends_s, services, issues, key, signature)


def _content(
    octets: Octets,
) -> tuple[int, int, frozenset[int], frozenset[int] | None, PublicKey | None]:
    present = octets.number()
    _skip_name(octets)
    octets.take(5)  # authority and series of revocations
    starts_s, unit = octets.number(4), octets.number()
    if unit not in _UNITS_S:
        raise UnreadableError
    ends_s = starts_s + int(_UNITS_S[unit] * octets.number(2))
    if present & 0x40:
        _skip_region(octets)
    octets.take(1 if present & 0x20 else 0)
    services = _services(octets, is_range=False) if present & 0x10 else frozenset()
    groups = [_group(octets) for _ in octets.entries()] if present & 0x08 else []
    known = [group for group in groups if group is not None]
    issues = frozenset[int]().union(*known) if len(known) == len(groups) else None
    for _ in octets.entries() if present & 0x04 else ():
        _group(octets)  # what it may request
    if present & 0x01:
        skip_encryption_key(octets)
    key = None
    if octets.number() == 0x80:
        curve = _curve(octets)
        key = PublicKey(curve, _point(octets, curve))
    else:
        _point(
            octets, EllipticCurve.NIST_P256
        )  # the value that an implicit certificate is reconstructed from
    if present & 0x80:
        octets.skip_additions()
    return starts_s, ends_s, services, issues, key


_UNITS_S = {0x80: 1e-6, 0x81: 1e-3, 0x82: 1, 0x83: 60, 0x84: 3600, 0x85: 216_000, 0x86: 31_556_952}
"""Units of a duration by their choice: us, ms, s, min, h, 60 h, years of 365.2425 days."""


def _skip_name(octets: Octets) -> None:
    choice = octets.number()
    if choice == 0x80:
        octets.take(24 if octets.number() & 0x80 else 11)
    elif choice in {0x81, 0x82}:
        octets.string()
    elif choice != 0x83:
        raise UnreadableError


def _skip_region(octets: Octets) -> None:
    choice = octets.number()
    if choice == 0x80:
        octets.take(10)
    elif choice in {0x81, 0x82}:
        octets.take(len(octets.entries()) * (16 if choice == 0x81 else 8))
    elif choice == 0x83:
        for _ in octets.entries():
            kind = octets.number()
            octets.take(2)
            if kind == 0x81:
                octets.take(len(octets.entries()))
            elif kind == 0x82:
                for _ in octets.entries():
                    octets.take(1)
                    octets.take(2 * len(octets.entries()))
            elif kind != 0x80:
                raise UnreadableError
    else:
        raise UnreadableError


def _services(octets: Octets, *, is_range: bool) -> frozenset[int]:
    """Read a list of services with their permissions, or with ranges of them."""
    found = set()
    for _ in octets.entries():
        has_permissions = octets.number()
        found.add(octets.integer())
        choice = octets.number() if has_permissions else 0x81 if is_range else None
        if choice == 0x80 and is_range:
            for _ in octets.entries():
                octets.string()
        elif choice is not None and not (choice == 0x81 and is_range):
            octets.string()
    return frozenset(found)


def _group(octets: Octets) -> frozenset[int] | None:
    """Read what a certificate may issue; None for everything."""
    present, choice = octets.number(), octets.number()
    services = _services(octets, is_range=True) if choice == 0x80 else None
    if choice not in {0x80, 0x81}:
        raise UnreadableError
    for bit in (0x80, 0x40):  # lengths of the chain below
        if present & bit:
            octets.string()
    octets.take(1 if present & 0x20 else 0)
    return services


def skip_encryption_key(octets: Octets) -> None:
    """Skip a key for encryption."""
    octets.number()
    _point(octets, _curve(octets))


def _curve(octets: Octets) -> EllipticCurve:
    choice = octets.number()
    for curve in EllipticCurve:
        if curve.value[0] == choice:
            if choice > EllipticCurve.BRAINPOOL_P256.value[0]:
                octets.length()  # of what later editions have added
            return curve
    raise UnreadableError


def _point(octets: Octets, curve: EllipticCurve) -> bytes:
    """Return a point in the encoding of SEC 1; the x coordinate alone where that is all."""
    choice = octets.number()
    if choice == _X_ONLY:
        return octets.take(curve.octets)
    if choice in {_EVEN_Y, _ODD_Y}:
        return bytes((choice - _X_ONLY,)) + octets.take(curve.octets)
    if choice == _BOTH:
        return b"\x04" + octets.take(2 * curve.octets)
    raise UnreadableError


def take_signature(octets: Octets) -> tuple[Signature, int]:
    """Read a signature; return where its r begins, too."""
    curve = _curve(octets)
    start = octets.at
    point = _point(octets, curve)
    if point[0] == 4 and len(point) > curve.octets + 1:
        raise UnreadableError  # its digest would be the one of the compressed form
    return Signature(curve, point[-curve.octets :], octets.take(curve.octets)), start
