"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {
    "judge": ("iptm_judges.cli:main", "ageing of a run by the laws of many cells"),
}
