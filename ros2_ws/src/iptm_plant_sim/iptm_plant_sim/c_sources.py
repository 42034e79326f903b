"""C files of the vehicle, with their constants from the Python forms of the same functions."""

from pathlib import Path

from iptm_core.c_sources import CSources

C_SOURCES = CSources(
    Path(__file__).resolve().parent / "c",
    {
        "interval": ("iptm_plant_sim.integrator",),
        "safety_monitor": ("iptm_core.state", "iptm_plant_sim.safety_monitor"),
    },
)
