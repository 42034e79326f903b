"""C files of the controller, with their constants from the Python forms of the same functions."""

from pathlib import Path

from iptm_core.c_sources import CSources

_SOLVER = "iptm_controller.solvers"
C_SOURCES = CSources(
    Path(__file__).resolve().parent / "c",
    {
        "controller": ("iptm_core.state",),
        "fallback": ("iptm_controller.ladder", "iptm_core.physics.car_following"),
        "forecast": (
            "iptm_controller.forecast",
            "iptm_controller.lead_check",
            "iptm_controller.preview_trust",
            "iptm_core.state",
        ),
        "forecast_size": ("iptm_controller.lead_check", "iptm_controller.preview_trust"),
        "guard": ("iptm_controller.safeguards",),
        "limiter": ("iptm_controller.safeguards",),
        "pack": ("iptm_controller.measurements",),
        "prices": ("iptm_controller.temperature_value",),
        "riccati": (f"{_SOLVER}.interface", f"{_SOLVER}.riccati.constants"),
        "sound": ("iptm_controller.measurements", "iptm_core.state"),
        "switching": (f"{_SOLVER}.switching_check",),
        "switching_size": (f"{_SOLVER}.switching_check", f"{_SOLVER}.riccati.backend"),
        "tick_data": ("iptm_controller.ocp.data",),
    },
)
