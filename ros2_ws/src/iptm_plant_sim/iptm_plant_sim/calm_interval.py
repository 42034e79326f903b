"""Intervals in which the safety monitor need not look closer, in C (`c/calm_interval.c`).

Most are like that: the measurements of the range sensor follow each other plainly, and all of them are safe.
The others go through `MonitoredInterval` in Python, which is the reference for these as well.
"""

from __future__ import annotations

import ctypes
import math
import struct
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from iptm_core.braking import SafetyMonitorSettings
from iptm_core.compilation import cache_directory, compile_sources
from iptm_core.frozen import replace
from iptm_core.lead_track import KEPT, LeadTrack
from iptm_core.parameters.model import BrakeParameters
from iptm_core.physics.ops import address, doubles
from iptm_core.signal_residuals import Residual
from iptm_core.state import LeaderPreview, LeaderState, VehicleState
from iptm_plant_sim.c_sources import C_SOURCES
from iptm_plant_sim.safety_monitor import RoadBraking

_FILES = ("calm_interval.c", "safety_monitor.c", "safety_monitor.h")
_ROW = struct.Struct("5d")
_MOST_MEASURED = 64


class CalmInterval:
    """Judges intervals of one vehicle; serves one thread."""

    def __init__(
        self, settings: SafetyMonitorSettings, brakes: BrakeParameters, library: ctypes.PyDLL
    ) -> None:
        self._settings, write = doubles(8)
        write(
            settings.monitor_reaction_s,
            settings.monitor_release_reaction_s,
            settings.monitor_hold_s,
            settings.monitor_margin_m,
            settings.gap_accuracy_m,
            settings.lead_speed_accuracy_m_s,
            brakes.delay_s,
            brakes.build_up_m_s3,
        )
        self._period_s = settings.monitor_period_s
        self._judge: Any = library.iptm_calm_interval
        self._over, self._write = doubles(18)
        self._found = (ctypes.c_double * 6)()
        self._rows = ctypes.create_string_buffer((KEPT + _MOST_MEASURED) * _ROW.size)
        self._in_rows = memoryview(self._rows)
        self._newest: LeadTrack | None = None

    def judged(
        self,
        state: VehicleState,
        track: LeadTrack,
        samples: LeaderPreview | None,
        road: RoadBraking,
        *,
        asked: tuple[float, float, float],
        duration_s: float,
        stands: bool,
    ) -> tuple[LeadTrack, float] | None:
        """Return the track after a calm interval and the smallest gap in it, None for any other interval.

        Args:
            state: at the start of the interval.
            track: the vehicle ahead as it was known then.
            samples: see `LeadMeasurements`.
            asked: acceleration that is requested, the one that follows, and share that brakes deliver.
            stands: the vehicle stays where it is.
        """
        remembered = len(track.recent)
        if samples is None or track.frozen or track.seen is None or not 0 < remembered <= KEPT:
            return None
        if track.is_doubtful:
            return None
        columns = [
            np.ascontiguousarray(each, dtype=np.float64)
            for each in (samples.times_s, samples.positions_m, samples.speeds_m_s)
        ]
        measured, *others = (each.size for each in columns)
        if not 2 <= measured <= _MOST_MEASURED or others != [measured] * 2:
            return None
        if track is not self._newest:
            for place, row in enumerate(track.recent):
                _ROW.pack_into(self._rows, place * _ROW.size, *row)
            self._newest = track
        full, slippery = road.full, road.slippery
        dry = slippery or full
        self._write(
            *(state.time_s, state.position_m, state.speed_m_s, stands, duration_s),
            *(self._period_s, *asked),
            *(full.own_m_s2, full.lead_m_s2, dry.own_m_s2, dry.lead_m_s2),
            slippery is not None,
            road.better_grip_m_s2,
            *(track.unexplained.value, track.unexplained.noise, track.unexplained.last),
        )
        given = self._settings, self._over, self._rows, remembered, measured
        kept = self._judge(*given, *map(address, columns), self._found)
        if not kept:
            return None
        recent = tuple(_ROW.iter_unpack(self._in_rows[: kept * _ROW.size]))
        acceleration_m_s2, period_s, smallest_gap_m, *unexplained = self._found
        self._newest = replace(
            track,
            seen=LeaderState(*recent[-1][:3]),
            acceleration_m_s2=acceleration_m_s2,
            period_s=period_s,
            recent=recent,
            empty_since_s=math.nan,
            unexplained=Residual(*unexplained),
        )
        return self._newest, smallest_gap_m


def calm_interval(settings: SafetyMonitorSettings, brakes: BrakeParameters) -> CalmInterval:
    """Return what judges the intervals of a vehicle."""
    return CalmInterval(settings, brakes, _library(cache_directory()))


@lru_cache
def _library(_folder: Path) -> ctypes.PyDLL:
    library = ctypes.PyDLL(str(compile_sources(C_SOURCES.read(*_FILES))))
    pointer, count = ctypes.c_void_p, ctypes.c_int
    library.iptm_calm_interval.argtypes = [*[pointer] * 3, count, count, *[pointer] * 4]
    library.iptm_calm_interval.restype = count
    return library
