"""The command `view`: the live view of `iptm_view`, with the reference car that this package can drive."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from iptm_view import cli

REFERENCE_COMMAND = (sys.executable, "-m", "iptm.runner.reference_drive")


def main(arguments: Sequence[str] | None = None) -> int:
    """Show a run in the browser; see `iptm_view.cli.main`."""
    return cli.main(arguments, REFERENCE_COMMAND)


if __name__ == "__main__":
    sys.exit(main())
