"""The same trip under another strategy, in memory, to compare a run with."""

from __future__ import annotations

from pathlib import Path

from iptm.run import Run

NO_COMPARISON = "none"


def save_comparison(path: Path, other: Run, heading: str) -> None:
    """Write the trajectory of a run as a Parquet file with the columns of an exported run.

    Raises:
        BagError: the file cannot be written.
    """
    # Loaded only now: it takes time that the nodes can use better.
    from iptm_ros.recording.export import (  # noqa: PLC0415
        export_table,
        trajectory_columns,
        write_parquet,
    )

    texts = {"table": "trajectory", "strategy": other.strategy, "compared_with": heading}
    write_parquet(path, export_table(trajectory_columns(other.trajectory), texts))
