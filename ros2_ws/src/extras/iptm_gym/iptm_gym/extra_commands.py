"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {
    "learn": ("iptm_gym.cli:main", "learn a policy on synthetic trips"),
}
