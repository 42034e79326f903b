"""Parameters of the visualizer node."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from iptm_core.declaration import parameter
from iptm_core.errors import ParameterError
from iptm_core.routes.road_line import RoadLine
from iptm_core.routes.user_csv import USER_SUFFIXES, read_user_trip
from iptm_core.settings import FrameSettings, ModelSettings
from iptm_core.user_input import is_path


@dataclass(frozen=True)
class VisualizerParameters(FrameSettings, ModelSettings):
    """Parameters of the node: those of the groups, the last of the bases first, and its own."""

    road: str = parameter(
        "",
        "recorded drive along whose road the scene lies: path of a .gpx file, of a .csv file with places, or "
        "FILE.xml#VEHICLE of SUMO with degrees; empty for a straight road",
    )
    rate_hz: float = parameter(
        20.0, "messages per second of wall time at most, of each topic", "Hz", 0.1, 200.0
    )

    def road_line(self) -> RoadLine | None:
        """Return where the road lies, None for a straight one."""
        if not self.road:
            return None
        allowed = "a drive with places (.gpx; .csv with latitude_deg and longitude_deg), or empty"
        if not is_path(self.road, USER_SUFFIXES):
            raise ParameterError(f"parameter road is {self.road!r}; allowed: {allowed}")
        line = read_user_trip(Path(self.road)).line
        if line is None:
            raise ParameterError(
                f"parameter road is {self.road!r}, a file without places; allowed: {allowed}"
            )
        return line
