"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {"codegen": ("iptm_ecu.command:main", "write the controller as C99")}
