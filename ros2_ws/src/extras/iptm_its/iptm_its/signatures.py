"""Verification of signed messages up to a trust anchor (IEEE 1609.2, TS 103 097).

ECDSA over the hash of what is signed and the hash of the certificate of the signer; certificates are signed
in the same way by their issuers. The curves are the work of cryptography, an optional extra. Signatures of
implicit certificates are not verified: cryptography does not add points.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from iptm_core.errors import ParameterError
from iptm_its.certificate import Certificate, EllipticCurve, PublicKey, Signature, read_certificate
from iptm_its.signed_message import SignedMessage, read_signed_message
from iptm_v2x_bridge.messages.octets import UnreadableError
from iptm_v2x_bridge.messages.packets import MessageKind, OpenedDatagram
from iptm_v2x_bridge.rejections import Rejection

HOW_TO = ".venv/bin/python -m pip install --require-hashes -r requirements/security.txt"
SUFFIXES = (".oer", ".cert")
SERVICES = {
    MessageKind.CAM: 36,
    MessageKind.SPATEM: 137,
    MessageKind.MAPEM: 138,
}
"""PSID of the services (TS 102 965)."""
MAX_SIGNERS = 1024
"""Certificates of signers that are held; the one that was used longest ago gives way."""
MAX_CHAIN = 3
_MS_PER_S = 1000


@cache
def _cryptography() -> tuple[Any, Any, Any, Any]:
    """Return the modules for curves, hashes, the form of signatures, and errors."""
    base = "cryptography.hazmat.primitives"
    names = (
        f"{base}.asymmetric.ec",
        f"{base}.hashes",
        f"{base}.asymmetric.utils",
        "cryptography.exceptions",
    )
    try:
        ec, hashes, utils, exceptions = (import_module(name) for name in names)
    except ImportError:
        raise ParameterError(
            "trust_anchors is given, but cryptography, which verifies signatures, is not installed; allowed: "
            f"'', or: {HOW_TO}"
        ) from None
    return ec, hashes, utils, exceptions


def is_signed_by(key: PublicKey, signature: Signature, signed: bytes, signer: bytes) -> bool:
    """Return whether a signature is right."""
    if key.curve is not signature.curve:
        return False
    ec, hashes, utils, exceptions = _cryptography()
    curves = {
        EllipticCurve.NIST_P256: ec.SECP256R1,
        EllipticCurve.BRAINPOOL_P256: ec.BrainpoolP256R1,
        EllipticCurve.BRAINPOOL_P384: ec.BrainpoolP384R1,
    }
    function = hashes.SHA256 if key.curve.octets == 32 else hashes.SHA384

    def hashed(octets: bytes) -> bytes:
        digest = hashes.Hash(function())
        digest.update(octets)
        return bytes(digest.finalize())

    numbers = (int.from_bytes(part, "big") for part in (signature.r, signature.s))
    try:
        public = ec.EllipticCurvePublicKey.from_encoded_point(curves[key.curve](), key.point)
        public.verify(
            utils.encode_dss_signature(*numbers),
            hashed(signed) + hashed(signer),
            ec.ECDSA(function()),
        )
    except (ValueError, exceptions.InvalidSignature):
        return False
    return True


def read_anchors(folder: str) -> tuple[Certificate, ...]:
    """Return the certificates in a folder (.oer, .cert; COER, one in a file).

    Raises:
        ParameterError: cryptography is not installed, the folder has no certificate or an unreadable one, or
            one that is self-signed has a wrong signature.
    """
    _cryptography()
    files = sorted(path for path in Path(folder).glob("*") if path.suffix in SUFFIXES)
    found = []
    for path in files:
        try:
            certificate = read_certificate(path.read_bytes())
        except (OSError, UnreadableError):
            certificate = None
        if certificate is None or certificate.key is None or certificate.signature is None:
            raise ParameterError(
                f"trust_anchors has {path.name!r}; allowed: explicit certificates of IEEE 1609.2 (COER)"
            )
        if certificate.issuer is None and not is_signed_by(
            certificate.key, certificate.signature, certificate.signed, b""
        ):
            raise ParameterError(
                f"trust_anchors has {path.name!r}, whose own signature is wrong; allowed: genuine ones"
            )
        found.append(certificate)
    if not found:
        raise ParameterError(
            f"trust_anchors is {folder!r}; allowed: a folder with certificates ({', '.join(SUFFIXES)})"
        )
    return tuple(found)


class Verifier:
    """Separates messages with a certificate chain to a trust anchor from others, and counts both.

    Every anchor is trusted itself, whether it belongs to a root or to an authority below. Without anchors
    nothing is verified.
    """

    def __init__(
        self, anchors: Iterable[Certificate] = (), *, refuses_unverified: bool = False
    ) -> None:
        """Set up a verifier."""
        self._anchors: Mapping[bytes, Certificate] = {each.digest: each for each in anchors}
        self._refuses_unverified = refuses_unverified
        self.forget()

    def forget(self) -> None:
        """Forget signers and counts."""
        self._signers: dict[bytes, Certificate] = {}
        self._verified = self._unverified = 0

    def check(self, opened: OpenedDatagram, now_ms: int) -> Rejection | None:
        """Return why a message is refused, None if it is not."""
        refused = self._verify(opened, now_ms) if self._anchors else Rejection.UNVERIFIED
        if refused is None:
            self._verified += 1
        elif refused is Rejection.UNVERIFIED:
            self._unverified += opened.secured
            return refused if self._refuses_unverified else None
        return refused

    def _verify(self, opened: OpenedDatagram, now_ms: int) -> Rejection | None:
        try:
            message = read_signed_message(opened.envelope)
        except UnreadableError:
            return Rejection.UNVERIFIED
        if message.service != SERVICES[opened.kind]:
            return Rejection.NOT_PERMITTED
        signer = self._signer(message, now_ms)
        if isinstance(signer, Rejection):
            return signer
        if signer.key is None:
            return Rejection.UNVERIFIED
        if not is_signed_by(signer.key, message.signature, message.signed, signer.octets):
            return Rejection.SIGNATURE
        times_s = [now_ms // _MS_PER_S]
        if message.generated_us is not None:
            times_s.append(message.generated_us // (1000 * _MS_PER_S))
        if not all(signer.starts_s <= time_s <= signer.ends_s for time_s in times_s):
            return Rejection.EXPIRED
        return None if message.service in signer.services else Rejection.NOT_PERMITTED

    def _signer(self, message: SignedMessage, now_ms: int) -> Certificate | Rejection:
        """Return the certificate of a signer whose issuers are trusted, or why there is none."""
        if isinstance(message.signer, bytes):
            known = self._signers.pop(message.signer, None)
            if known is not None:
                self._signers[message.signer] = known
            return known or Rejection.UNKNOWN_SIGNER
        certificate = message.signer[0]
        if certificate.digest not in self._signers:
            refused = self._vouched_for(message.signer[:MAX_CHAIN], message.service, now_ms)
            if refused is not None:
                return refused
            if len(self._signers) >= MAX_SIGNERS:
                del self._signers[next(iter(self._signers))]
        return self._signers.setdefault(certificate.digest, certificate)

    def _vouched_for(
        self, chain: tuple[Certificate, ...], service: int, now_ms: int
    ) -> Rejection | None:
        """Return why an anchor does not vouch for the first certificate of a chain, None if one does."""
        certificate = chain[0]
        if certificate.digest in self._anchors:
            return None
        if certificate.key is None or certificate.signature is None:
            return Rejection.UNVERIFIED
        issuer = self._anchors.get(certificate.issuer or b"")
        if issuer is None:
            if len(chain) < 2 or chain[1].digest != certificate.issuer:
                return Rejection.UNKNOWN_SIGNER
            issuer = chain[1]
            refused = self._vouched_for(chain[1:], service, now_ms)
            if refused is not None:
                return refused
        if issuer.key is None or not is_signed_by(
            issuer.key, certificate.signature, certificate.signed, issuer.octets
        ):
            return Rejection.SIGNATURE
        if not issuer.starts_s <= now_ms // _MS_PER_S <= issuer.ends_s:
            return Rejection.EXPIRED
        return (
            None if issuer.issues is None or service in issuer.issues else Rejection.NOT_PERMITTED
        )

    def report(self) -> dict[str, object]:
        """Return numbers for the diagnostics."""
        return {
            "signatures_verified": self._verified,
            "signatures_not_verified": self._unverified,
        }
