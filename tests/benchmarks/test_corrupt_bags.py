"""A few corrupt bags of the campaign, and that it would notice readers which lie."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from benchmarks import corrupt_bags
from mcap.reader import make_reader

from iptm_recording.storage import StorageFile


def test_every_reader_ends_with_the_truth_or_one_sentence() -> None:
    campaign = corrupt_bags.run(cases=9, seed=20)
    assert campaign.failures == []
    assert campaign.cases == 9
    assert sum(campaign.outcomes["recover_bag"].values()) == 9


def test_silent_loss_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Readers that neither check the summary nor count, as ordinary ones do."""
    original = corrupt_bags.make_original(tmp_path / "whole" / "run", "none")
    bag = corrupt_bags.make_original(tmp_path / "run", "none").folder
    file = bag / "run_0.mcap"
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[1]
    times = chunk.message_start_time, chunk.message_end_time, chunk.chunk_start_offset
    data = bytearray(file.read_bytes())
    # One byte makes the entry of a chunk a record of a kind that readers skip.
    data[data.index(struct.pack("<QQQ", *times)) - 9] = 0x88
    file.write_bytes(data)
    campaign = corrupt_bags.Campaign()
    assert list(corrupt_bags._try_readers(bag, original, campaign)) == []
    assert campaign.outcomes["bag_info"]["refused"] == 1
    monkeypatch.setattr("iptm_recording.mcap_storage.summary_start", lambda _: 0)
    monkeypatch.setattr("iptm_recording.mcap_storage.check_data_section", lambda _: None)
    monkeypatch.setattr(StorageFile, "_compare_counts", lambda *_: None)
    failures = list(corrupt_bags._try_readers(bag, original, corrupt_bags.Campaign()))
    assert any("other messages" in failure for failure in failures)
