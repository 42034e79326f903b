"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {
    "plan": ("iptm_plan.cli:main", "when to charge, how far, and what a kelvin costs at the door"),
}
