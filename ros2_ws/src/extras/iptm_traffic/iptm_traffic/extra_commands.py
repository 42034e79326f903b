"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {"traffic": ("iptm_traffic.cli:main", "drive through simulated traffic (SUMO)")}
