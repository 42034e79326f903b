"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {"fmu": ("iptm_fmi.command:main", "write plant, controller or meter as an FMU")}
