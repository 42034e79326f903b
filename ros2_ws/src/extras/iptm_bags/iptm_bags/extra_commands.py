"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {
    "info": ("iptm_bags.reading:info", "list what a bag holds, and the figures of its run"),
    "compare": (
        "iptm_bags.reading:compare",
        "compare runs, or two bags message by message (--exact)",
    ),
    "export": ("iptm_bags.reading:export", "write a run or a topic as CSV or Parquet"),
    "replay": ("iptm_bags.player_cli:main", "play a bag with its recorded timing"),
    "recover": ("iptm_bags.command:main", "rescue the messages of a damaged bag"),
    "check": ("iptm_bags.command:check", "compare a node with what it answered in a bag"),
}
