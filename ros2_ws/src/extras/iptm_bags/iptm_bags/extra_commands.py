"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {
    "recover": ("iptm_bags.command:main", "rescue the messages of a damaged bag"),
    "check": ("iptm_bags.command:check", "compare a node with what it answered in a bag"),
}
