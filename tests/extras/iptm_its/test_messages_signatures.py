"""Signatures of real packets, of a public-key infrastructure of our own, and wrong ones."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.extras.iptm_its.certificates import (
    ALL,
    NAMES,
    NOW_S,
    Owner,
    Types,
    message,
    owner,
    services,
)
from tests.iptm_v2x_bridge import real_packets
from tests.iptm_v2x_bridge.radio import ROAD, datagram

from iptm_core.errors import ParameterError
from iptm_its import signatures
from iptm_its.certificate import Certificate, read_certificate
from iptm_its.signatures import Verifier, is_signed_by, read_anchors
from iptm_its.signed_message import read_signed_message
from iptm_v2x_bridge.cam_bridge import CamBridge
from iptm_v2x_bridge.messages.octets import UnreadableError
from iptm_v2x_bridge.messages.packets import (
    MessageKind,
    OpenedDatagram,
    open_datagram,
)
from iptm_v2x_bridge.rejections import Rejection
from iptm_v2x_bridge.settings import CamSettings

NOW_MS = 1000 * NOW_S
WITH_CERTIFICATE = ("SALZBURG", "GOLF", "BRIDGED", "COHDA", "WARNING")
BEHIND_BASIC_HEADER = slice(4, None)


def envelope(name: str) -> bytes:
    return bytes(getattr(real_packets, name)[BEHIND_BASIC_HEADER])


def certificate_of(name: str) -> Certificate:
    signer = read_signed_message(envelope(name)).signer
    assert not isinstance(signer, bytes)
    return signer[0]


def certificate(of: Owner) -> Certificate:
    return read_certificate(of.octets)


def is_right(name: str, octets: bytes) -> bool:
    found = read_signed_message(octets)
    signer = certificate_of(name)
    assert signer.key is not None
    return is_signed_by(signer.key, found.signature, found.signed, signer.octets)


@pytest.mark.parametrize("name", WITH_CERTIFICATE)
def test_real_packets_are_verified_and_none_with_a_flipped_bit_is(name: str) -> None:
    octets = envelope(name)
    assert is_right(name, octets)
    issued = certificate_of(name).signature
    assert issued is not None
    # The stated hash and the signs of the y coordinates of r play no part.
    unused = {2, len(octets) - 65, octets.index(issued.r) - 1}
    for bit in range(0, 8 * len(octets), 7):
        broken = bytearray(octets)
        broken[bit // 8] ^= 1 << bit % 8
        try:
            found = read_signed_message(bytes(broken))
        except UnreadableError:
            continue
        if found.signer != read_signed_message(octets).signer:
            continue  # its issuer did not sign this certificate
        assert bit // 8 in unused or not is_right(name, bytes(broken))


def test_the_certificate_of_one_message_verifies_the_next_ones_of_the_car() -> None:
    for name, other in (("GOLF", "GOLF_EARLIER"), ("COHDA", "COHDA_LATER")):
        signer = read_signed_message(envelope(other)).signer
        assert signer == certificate_of(name).digest
        known = certificate_of(name)
        verifier = Verifier([replace(known)])
        now_ms = (read_signed_message(envelope(other)).generated_us or 0) // 1000
        opened = [
            open_datagram(getattr(real_packets, each), (MessageKind.CAM,)) for each in (name, other)
        ]
        assert all(isinstance(each, OpenedDatagram) for each in opened)
        first, second = opened
        assert verifier.check(second, now_ms) is Rejection.UNKNOWN_SIGNER  # type: ignore[arg-type]
        assert verifier.check(first, now_ms) is None  # type: ignore[arg-type]
        assert verifier.check(second, now_ms) is None  # type: ignore[arg-type]
        assert verifier.report()["signatures_verified"] == 2
    assert certificate_of("GOLF").digest.hex() == "127cff384ce0b890"
    assert (certificate_of("GOLF").issuer or b"").hex() == "56dfd6d627a362dc"


@pytest.mark.parametrize("name", [*WITH_CERTIFICATE, "SNIFFED", "GOLF_EARLIER", "COHDA_LATER"])
def test_another_decoder_reads_the_same(name: str) -> None:
    Types.Ieee1609Dot2Data.from_coer(envelope(name))
    content = Types.Ieee1609Dot2Data.get_val()["content"][1]
    found = read_signed_message(envelope(name))
    assert found.service == content["tbsData"]["headerInfo"]["psid"]
    assert found.generated_us == content["tbsData"]["headerInfo"]["generationTime"]
    assert found.signature.s == content["signature"][1]["sSig"]
    kind, who = content["signer"]
    if kind == "digest":
        assert found.signer == who
        return
    assert not isinstance(found.signer, bytes)
    same_as(found.signer[0], who[0])


def same_as(found: Certificate, value: dict[str, Any]) -> None:
    content = value["toBeSigned"]
    period = content["validityPeriod"]
    seconds = {"hours": 3600, "years": 31_556_952, "minutes": 60}[period["duration"][0]]
    assert found.starts_s == period["start"]
    assert found.ends_s - found.starts_s == seconds * period["duration"][1]
    assert found.services == {entry["psid"] for entry in content.get("appPermissions", ())}
    assert found.issuer == (None if value["issuer"][0] == "self" else value["issuer"][1])
    key, (form, point) = content["verifyKeyIndicator"][1]
    assert found.key is not None
    x = point["x"] if form.startswith("uncompressed") else point
    assert found.key.point[1 : 1 + len(x)] == x
    Types.ToBeSignedCertificate.set_val(content)
    assert found.signed == Types.ToBeSignedCertificate.to_coer()
    assert list(NAMES).index(key) >= 0


REGIONS = [
    ("circularRegion", {"center": {"latitude": 1, "longitude": 2}, "radius": 3}),
    (
        "rectangularRegion",
        [
            {
                "northWest": {"latitude": 1, "longitude": 2},
                "southEast": {"latitude": 0, "longitude": 3},
            }
        ],
    ),
    ("polygonalRegion", [{"latitude": number, "longitude": 2} for number in range(3)]),
    (
        "identifiedRegion",
        [
            ("countryOnly", 276),
            ("countryAndRegions", {"countryOnly": 250, "regions": [1, 2, 3]}),
        ],
    ),
]
PARTS: list[dict[str, Any]] = [
    {},
    {"id": ("name", "authority")},
    {"id": ("binaryId", b"12345678")},
    {"id": ("linkageData", {"iCert": 1, "linkage-value": bytes(9)})},
    {
        "assuranceLevel": b"\xc0",
        "appPermissions": [{"psid": 36}, {"psid": 37, "ssp": ("opaque", b"ab")}],
    },
    {"certRequestPermissions": [services(36)], "canRequestRollover": 0},
    {
        "encryptionKey": {
            "supportedSymmAlg": "aes128Ccm",
            "publicKey": ("eciesNistP256", ("compressed-y-0", bytes(32))),
        }
    },
    *({"region": region} for region in REGIONS),
]


@pytest.mark.parametrize("part", PARTS, ids=lambda part: "-".join(part) or "none")
@pytest.mark.parametrize("curve", NAMES)
def test_certificates_with_all_parts_are_read(part: dict[str, Any], curve: str) -> None:
    for uncompressed in (False, True):
        made = owner(
            None, curve, uncompressed=uncompressed, certIssuePermissions=[services(36, 37)], **part
        )
        Types.CertificateBase.from_coer(made.octets)
        found = certificate(made)
        same_as(found, Types.CertificateBase.get_val())
        assert found.issues == {36, 37}
        assert found.key is not None
        assert found.signature is not None
        assert is_signed_by(found.key, found.signature, found.signed, b"")


def station(issuer: Owner, **more: Any) -> Owner:
    return owner(issuer, appPermissions=[{"psid": 36}], **more)


@pytest.mark.parametrize("curve", NAMES)
def test_an_anchor_vouches_for_a_station_directly_or_through_an_authority(curve: str) -> None:
    root = owner(None, curve, certIssuePermissions=[ALL])
    authority = owner(root, certIssuePermissions=[services(36)])
    car = station(authority)
    direct = Verifier([certificate(authority)])
    assert direct.check(message(car), NOW_MS) is None
    assert direct.check(message(car, digest=True), NOW_MS) is None
    from_root = Verifier([certificate(root)])
    assert from_root.check(message(car), NOW_MS) is Rejection.UNKNOWN_SIGNER
    assert from_root.check(message(car, authority), NOW_MS) is None
    assert from_root.report() == {"signatures_verified": 1, "signatures_not_verified": 0}


def test_what_is_refused_and_why() -> None:
    authority = owner(certIssuePermissions=[services(36)])
    car, verifier = station(authority), Verifier([certificate(authority)])
    cases = {
        Rejection.UNKNOWN_SIGNER: [message(station(owner(certIssuePermissions=[ALL])))],
        Rejection.EXPIRED: [
            message(station(authority, hours=1, starts_s=NOW_S - 7200)),
            message(station(authority, starts_s=NOW_S + 60)),
            message(car, at_s=NOW_S - 86_400),
        ],
        Rejection.NOT_PERMITTED: [
            message(car, psid=37),
            message(owner(authority, appPermissions=[{"psid": 37}])),
            replace(message(car), kind=MessageKind.MAPEM),
        ],
    }
    for reason, refused in cases.items():
        for opened in refused:
            assert verifier.check(opened, NOW_MS) is reason
    forged = message(Owner(car.curve, owner().key, car.octets))
    assert verifier.check(forged, NOW_MS) is Rejection.SIGNATURE
    impostor = station(Owner(authority.curve, owner().key, authority.octets))
    assert verifier.check(message(impostor), NOW_MS) is Rejection.SIGNATURE
    assert verifier.report()["signatures_verified"] == 0
    other = Verifier([certificate(owner(certIssuePermissions=[services(37)]))])
    assert other.check(message(car), NOW_MS) is Rejection.UNKNOWN_SIGNER
    narrow = owner(certIssuePermissions=[services(37)])
    assert (
        Verifier([certificate(narrow)]).check(message(station(narrow)), NOW_MS)
        is Rejection.NOT_PERMITTED
    )


def test_an_expired_authority_vouches_for_nobody() -> None:
    authority = owner(certIssuePermissions=[ALL], hours=1, starts_s=NOW_S - 7200)
    verifier = Verifier([certificate(authority)])
    assert verifier.check(message(station(authority)), NOW_MS) is Rejection.EXPIRED


def test_headers_with_more_than_a_time_are_read() -> None:
    authority = owner(certIssuePermissions=[ALL])
    car, verifier = station(authority), Verifier([certificate(authority)])
    full = message(
        car,
        expiryTime=10**15,
        generationLocation={"latitude": 1, "longitude": 2, "elevation": 3},
        p2pcdLearningRequest=b"abc",
        inlineP2pcdRequest=[b"abc", b"def"],
    )
    assert verifier.check(full, NOW_MS) is None


def test_unsigned_messages_count_unless_they_are_refused(tmp_path: Path) -> None:
    authority = owner(certIssuePermissions=[ALL])
    plain = datagram(4711, 0, 50.0, 12.0)
    for refuses, expected in ((False, None), (True, Rejection.UNVERIFIED)):
        verifier = Verifier([certificate(authority)], refuses_unverified=refuses)
        bridge = CamBridge(ROAD, verifier=verifier)
        assert bridge.receive(plain, 0) is expected
        assert bridge.report().get("rejected_unverified", 0) == int(refuses)
    (tmp_path / "authority.cert").write_bytes(authority.octets)
    with pytest.raises(ParameterError, match="refuse_unverified"):
        CamSettings(refuse_unverified=True).build_verifier()
    built = CamSettings(refuse_unverified=True, trust_anchors=str(tmp_path)).build_verifier()
    assert built.check(message(station(authority)), NOW_MS) is None


def test_implicit_certificates_are_not_verified() -> None:
    authority = owner(certIssuePermissions=[ALL])
    Types.CertificateBase.from_coer(station(authority).octets)
    value = Types.CertificateBase.get_val()
    value["type"] = "implicit"
    del value["signature"]
    value["toBeSigned"]["verifyKeyIndicator"] = (
        "reconstructionValue",
        ("compressed-y-0", bytes(32)),
    )
    Types.CertificateBase.set_val(value)
    octets = Types.CertificateBase.to_coer()
    assert read_certificate(octets).key is None
    car = Owner("ecdsaNistP256", owner().key, octets)
    verifier = Verifier([certificate(authority)])
    assert verifier.check(message(car), NOW_MS) is None
    assert verifier.report() == {"signatures_verified": 0, "signatures_not_verified": 1}


def test_anchors_are_certificates_in_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ParameterError, match="a folder with certificates"):
        read_anchors(str(tmp_path))
    root = owner(certIssuePermissions=[ALL])
    (tmp_path / "root.oer").write_bytes(root.octets)
    assert read_anchors(str(tmp_path)) == (certificate(root),)
    (tmp_path / "x.oer").write_bytes(root.octets[:-1] + bytes((root.octets[-1] ^ 1,)))
    with pytest.raises(ParameterError, match=r"x\.oer"):
        read_anchors(str(tmp_path))
    (tmp_path / "x.oer").write_bytes(b"certificate")
    with pytest.raises(ParameterError, match=r"x\.oer"):
        read_anchors(str(tmp_path))

    def without(name: str) -> Any:
        raise ImportError(name)

    monkeypatch.setattr(signatures, "import_module", without)
    signatures._cryptography.cache_clear()
    with pytest.raises(ParameterError, match=r"requirements/security\.txt"):
        read_anchors(str(tmp_path))
    monkeypatch.undo()
    signatures._cryptography.cache_clear()
