"""A trip of a user: speed, slope and road as a file holds them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from iptm_core.routes.cycles import DrivingCycle
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.slope import SlopeProfile

if TYPE_CHECKING:
    from iptm_core.routes.track import RecordedDrive


@dataclass(frozen=True, eq=False)
class UserTrip:
    """A trip as a file holds it.

    Attributes:
        cycle: speed at 1 Hz.
        slope: slope of its road (position 0 is the start of the trip), None if not in the file.
        drive: raw points of a recorded drive, None for a plain table.
        notes: repairs and omissions.
        launch_s: length of the launch ramp in front of the drive.
    """

    cycle: DrivingCycle
    slope: SlopeProfile | None
    line: RoadLine | None = None
    drive: RecordedDrive | None = None
    notes: tuple[str, ...] = ()
    launch_s: float = 0.0
