"""The program `iptm`: ``python -m iptm COMMAND``."""

import sys

from iptm.commands.tree import main

if __name__ == "__main__":
    sys.exit(main())
