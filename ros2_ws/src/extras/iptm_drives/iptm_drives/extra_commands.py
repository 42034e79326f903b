"""Commands that this extra adds to the program `iptm`."""

COMMANDS = {
    "drive": ("iptm_drives.commands:drive", "show a recorded drive, or read one from a CAN log"),
    "train": ("iptm_drives.commands:train", "train the predictor of the leader"),
}
