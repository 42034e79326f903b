"""Settings of the controller that were changed during a recording, from its diagnostics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from iptm_core.errors import BagError
from iptm_interfaces.diagnostics import CHANGED_SETTINGS, SETTINGS_SINCE, status_values
from iptm_interfaces.topics import TOPICS, Topic
from iptm_recording.bag_reader import BagReader
from iptm_recording.trajectory_reader import trip_starts_ns

_MOST_IN_FULL = 3


@dataclass(frozen=True)
class SettingsChange:
    """One change.

    Attributes:
        since_s: first tick that was decided with the new settings.
        what: names, new and former values.
        is_of_last_trip: not of a trip before the one that counts.
    """

    since_s: float
    what: str
    is_of_last_trip: bool = True

    def __str__(self) -> str:
        """Return the change in words."""
        return f"from {self.since_s:g} s on {self.what}"


def changes_in_words(changes: Sequence[SettingsChange]) -> list[str]:
    """Return what the figures of the last trip have to be read with, a few sentences at most."""
    earlier = [change for change in changes if not change.is_of_last_trip]
    during = [change for change in changes if change.is_of_last_trip]
    texts = []
    if earlier:
        texts.append(f"changed in an earlier trip: {_shortened([each.what for each in earlier])}")
    if during:
        texts.append(f"changed while driving: {_shortened([str(each) for each in during])}")
    return texts


def _shortened(entries: Sequence[str]) -> str:
    if len(entries) <= _MOST_IN_FULL:
        return "; ".join(entries)
    return f"{len(entries)} times, first {entries[0]}; last {entries[-1]}"


def read_settings_changes(path: Path, namespace: str | None = None) -> list[SettingsChange]:
    """Return the changes inside a bag, in order; settings from before the bag are not listed.

    Args:
        path: bag folder or file.
        namespace: of the vehicle; None takes all there are.

    Raises:
        BagError: the bag cannot be read.
    """
    name = TOPICS[Topic.DIAGNOSTICS].name
    prefix = None if namespace is None else f"/{namespace.strip('/')}/".replace("//", "/")
    changes: list[SettingsChange] = []
    since: dict[str, str] = {}
    with BagReader(path) as reader:
        if name not in reader.topics:
            return []
        last_trip_ns = _last_trip_ns(reader, namespace)
        for item in reader.messages([name]):
            for status in item.message.status:
                values = status_values(status)
                now = values.get(SETTINGS_SINCE)
                if now is None or (prefix and status.name.rpartition("/")[0] + "/" != prefix):
                    continue
                before = since.get(status.name, now)
                since[status.name] = now
                if now != before and CHANGED_SETTINGS in values and _is_number(now):
                    is_last = item.log_time_ns >= last_trip_ns
                    changes.append(SettingsChange(float(now), values[CHANGED_SETTINGS], is_last))
    return changes


def refuse_changed_settings(path: Path, namespace: str | None = None) -> None:
    """Refuse a bag inside which settings were changed; for arguments see `read_settings_changes`.

    Raises:
        BagError: they were, or the bag cannot be read.
    """
    changes = read_settings_changes(path, namespace)
    if changes:
        raise BagError(
            f"settings of {path} were changed while it drove ({changes[0]}); allowed: settings that stay,"
            " as those of the start are taken for all ticks"
        )


def _last_trip_ns(reader: BagReader, namespace: str | None) -> int:
    try:
        return trip_starts_ns(reader, namespace)[-1]
    except BagError:  # diagnostics without a plant, or of several vehicles
        return 0


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
