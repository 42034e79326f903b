"""What this extra adds to the core (see `iptm_core.routes.user_csv`): drives in any file, cleaned."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from iptm_core.routes.drive_table import DriveTable
from iptm_drives.cleaning import clean
from iptm_drives.named_table import columns_table
from iptm_drives.reading import read_drive_table, read_road

__all__ = ["drive_in_columns", "drive_in_file", "read_road"]


def drive_in_file(path: Path) -> DriveTable:
    """Return the drive in a file, cleaned; behind a ``#`` stands the vehicle, or the columns."""
    return clean(read_drive_table(path))


def drive_in_columns(columns: Mapping[str, object], name: str) -> DriveTable:
    """Return the drive in columns of a table in memory, cleaned."""
    return clean(columns_table(columns, name))
