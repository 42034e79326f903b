"""Strings of vehicles for `iptm run --vehicles` and the launch file `string.launch.py`."""

from iptm_string.order import MAX_VEHICLES, vehicle_count
from iptm_string.running import run_string, trips_in_string

__all__ = ["MAX_VEHICLES", "run_string", "trips_in_string", "vehicle_count"]
