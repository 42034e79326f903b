"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {
    "bench": ("iptm_vehicle_interface.node_bench:main", "drive a car on a CAN bus in real time"),
    "meter": (
        "iptm_vehicle_interface.meter:main",
        "energy, temperatures and ageing of a recorded or a live drive",
    ),
}
