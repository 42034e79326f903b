"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {"recover": ("iptm_bags.command:main", "rescue the messages of a damaged bag")}
