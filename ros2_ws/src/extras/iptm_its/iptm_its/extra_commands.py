"""Command that this extra adds to the program `iptm`."""

COMMANDS = {"send": ("iptm_its.sending:main", "send a drive as V2X messages (ETSI CAM)")}
