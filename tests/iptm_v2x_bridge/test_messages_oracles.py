"""Other people's codecs as oracles; each is left out, with a reason, where it is not installed."""

from __future__ import annotations

import json
import random
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest
from tests.iptm_v2x_bridge.cams import cam, path
from tests.iptm_v2x_bridge.random_cams import random_fields

from iptm_v2x_bridge.messages.cam import encode_cam, encode_fields, specification
from iptm_v2x_bridge.messages.packets import wrap

ETHERTYPE = 0x8947


def capture(path: Path, packets: list[bytes]) -> None:
    """Write packets as a capture file of an Ethernet link."""
    blocks = [struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65_535, 1)]
    for packet in packets:
        frame = b"\xff" * 6 + b"\x02" + bytes(5) + struct.pack("!H", ETHERTYPE) + packet
        blocks.append(struct.pack("<IIII", 0, 0, len(frame), len(frame)) + frame)
    path.write_bytes(b"".join(blocks))


def find(tree: Any, key: str) -> Any:
    """Return the first value of a key, wherever it is in nested dictionaries and lists."""
    if isinstance(tree, dict):
        if key in tree:
            return tree[key]
        tree = list(tree.values())
    if isinstance(tree, list):
        for entry in tree:
            found = find(entry, key)
            if found is not None:
                return found
    return None


@pytest.fixture(scope="module")
def dissected(tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    """What Wireshark reads in packets with a plain message and one with a predicted path."""
    if shutil.which("tshark") is None:
        pytest.skip("tshark is not installed")
    sender = (600_000_000_123, (48.1234567, 10.7654321), 20.0)
    file = tmp_path_factory.mktemp("capture") / "cam.pcap"
    messages = [cam(), cam(path=path())]
    capture(file, [wrap(encode_cam(message), 4711, 5, *sender) for message in messages])
    result = subprocess.run(
        ["tshark", "-r", str(file), "-T", "json"], capture_output=True, text=True, check=True
    )
    return list(json.loads(result.stdout))


def test_wireshark_reads_what_was_meant(dissected: list[Any]) -> None:
    for packet in dissected:
        layers = packet["_source"]["layers"]
        assert "_ws.malformed" not in layers
        assert find(layers, "btpb.dstport") == "2001"
        assert find(layers, "its.stationID") == "4711"
        assert find(layers, "cam.generationDeltaTime") == "12345"
        assert find(layers, "its.latitude") == "481234567"
        assert find(layers, "its.longitude") == "107654321"
        assert find(layers, "its.speedValue") == "2000"
        assert find(layers, "its.headingValue") == "0"
        assert find(layers, "its.vehicleLengthValue") == "45"
        assert find(layers, "cam.vehicleWidth") == "18"
        assert find(layers, "its.altitudeValue") == "51230"


def test_wireshark_reads_the_packet_around_it(dissected: list[Any]) -> None:
    layers = dissected[0]["_source"]["layers"]
    text = json.dumps(layers)
    assert find(layers, "geonw.ch.htype") is not None, text
    assert int(find(layers, "geonw.src_pos.tst")) == 600_000_000_123 % 2**32, text


def test_bits_are_those_of_pycrate() -> None:
    modules = pytest.importorskip(
        "pycrate_asn1dir.ITS_CAM_2", reason="pycrate is not installed (it takes 250 MB)"
    )
    reference = modules.CAM_PDU_Descriptions.CAM
    source = random.Random(12)  # noqa: S311 - no secret
    for _ in range(400):
        bits = encode_fields("CAM", random_fields(source))
        reference.from_uper(bits)
        value = reference.get_val()
        own = specification().decode("CAM", bits)
        vehicle, own_vehicle = (
            value["cam"]["camParameters"]["highFrequencyContainer"][1],
            own["params"]["high"][1],
        )
        assert vehicle["speed"]["speedValue"] == own_vehicle["speed"]["value"]
        assert vehicle["heading"]["headingValue"] == own_vehicle["heading"]["value"]
        assert reference.to_uper() == bits
