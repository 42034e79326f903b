"""Factors between the units that people use and SI units."""

from __future__ import annotations

CELSIUS_ZERO_K = 273.15
KM_H_PER_M_S = 3.6
M_S_PER_MPH = 0.44704
SECONDS_PER_HOUR = 3600.0
SECONDS_PER_DAY = 86400.0
J_PER_KWH = 3.6e6
