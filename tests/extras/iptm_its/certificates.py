"""A public-key infrastructure for the tests of signatures: encoded by pycrate, signed by cryptography."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from hashlib import sha256, sha384
from typing import Any

import pytest

from iptm_v2x_bridge.messages.packets import MessageKind, OpenedDatagram

ec = pytest.importorskip(
    "cryptography.hazmat.primitives.asymmetric.ec",
    reason="requirements/security.txt is not installed",
)
pytest.importorskip("pycrate_asn1dir", reason="requirements/roadside.txt is not installed")

from cryptography.hazmat.primitives import hashes  # noqa: E402
from cryptography.hazmat.primitives.asymmetric.utils import decode_dss_signature  # noqa: E402
from pycrate_asn1dir.ITS_IEEE1609_2 import Ieee1609Dot2 as Types  # noqa: E402

NOW_S = 700_000_000
NAMES = {
    "ecdsaNistP256": (ec.SECP256R1, hashes.SHA256, sha256, 32),
    "ecdsaBrainpoolP256r1": (ec.BrainpoolP256R1, hashes.SHA256, sha256, 32),
    "ecdsaBrainpoolP384r1": (ec.BrainpoolP384R1, hashes.SHA384, sha384, 48),
}
ALL = {"subjectPermissions": ("all", 0), "minChainLength": 2, "eeType": (0b1100_0000, 8)}


def services(*numbers: int) -> dict[str, Any]:
    """Return what an authority may issue."""
    ranges = [{"psid": number, "sspRange": ("opaque", [b"\x01\xff"])} for number in numbers]
    return {"subjectPermissions": ("explicit", ranges), "chainLengthRange": 0}


@dataclass
class Owner:
    """A key and its certificate."""

    curve: str
    key: Any
    octets: bytes = b""

    def sign(self, signed: bytes, signer: bytes) -> tuple[str, dict[str, Any]]:
        """Return a signature as pycrate takes it."""
        _, function, hashed, size = NAMES[self.curve]
        data = hashed(signed).digest() + hashed(signer).digest()
        r, s = decode_dss_signature(self.key.sign(data, ec.ECDSA(function())))
        value = {"rSig": ("x-only", r.to_bytes(size, "big")), "sSig": s.to_bytes(size, "big")}
        return f"{self.curve}Signature", value


def owner(
    issuer: Owner | None = None,
    curve: str = "ecdsaNistP256",
    *,
    uncompressed: bool = False,
    hours: int = 168,
    starts_s: int = NOW_S - 3600,
    **more: Any,
) -> Owner:
    """Return someone with a certificate; without an issuer it signs itself."""
    group, _, _, size = NAMES[curve]
    made = Owner(curve, ec.generate_private_key(group()))
    numbers = made.key.public_key().public_numbers()
    x, y = (value.to_bytes(size, "big") for value in (numbers.x, numbers.y))
    compressed = ("compressed-y-1" if numbers.y % 2 else "compressed-y-0", x)
    both = f"uncompressedP{8 * size}"
    content = {
        "id": ("none", 0),
        "cracaId": bytes(3),
        "crlSeries": 0,
        "validityPeriod": {"start": starts_s, "duration": ("hours", hours)},
        "verifyKeyIndicator": (
            "verificationKey",
            (curve, (both, {"x": x, "y": y}) if uncompressed else compressed),
        ),
        **more,
    }
    issued = ("self", "sha256")
    if issuer is not None:
        hashed = NAMES[issuer.curve][2]
        digest = hashed(issuer.octets).digest()[-8:]
        issued = (f"{hashed().name}AndDigest", digest)
    value = {"version": 3, "type": "explicit", "issuer": issued, "toBeSigned": content}
    Types.ToBeSignedCertificate.set_val(deepcopy(content))
    signed = Types.ToBeSignedCertificate.to_coer()
    by = issuer or made
    value["signature"] = by.sign(signed, issuer.octets if issuer else b"")
    Types.CertificateBase.set_val(value)
    made.octets = Types.CertificateBase.to_coer()
    return made


def message(
    signer: Owner,
    *chain: Owner,
    psid: int = 36,
    digest: bool = False,
    at_s: float = NOW_S,
    **more: Any,
) -> OpenedDatagram:
    """Return a message in an envelope; of `more` the header is made, too."""
    tbs = {
        "payload": {
            "data": {"protocolVersion": 3, "content": ("unsecuredData", bytes(range(150)))}
        },
        "headerInfo": {"psid": psid, "generationTime": round(at_s * 1e6), **more},
    }
    Types.ToBeSignedData.set_val(deepcopy(tbs))
    signed = Types.ToBeSignedData.to_coer()
    certificates = []
    for each in (signer, *chain):
        Types.CertificateBase.from_coer(each.octets)
        certificates.append(deepcopy(Types.CertificateBase.get_val()))
    who = (
        ("digest", sha256(signer.octets).digest()[-8:]) if digest else ("certificate", certificates)
    )
    Types.Ieee1609Dot2Data.set_val(
        {
            "protocolVersion": 3,
            "content": (
                "signedData",
                {
                    "hashId": "sha256",
                    "tbsData": tbs,
                    "signer": who,
                    "signature": signer.sign(signed, signer.octets),
                },
            ),
        }
    )
    return OpenedDatagram(MessageKind.CAM, b"", None, Types.Ieee1609Dot2Data.to_coer())
