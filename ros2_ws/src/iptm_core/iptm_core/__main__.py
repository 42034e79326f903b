"""Run a program of the suite: `python -m iptm_core MODULE [ARGUMENTS]`."""

import sys

if __name__ == "__main__":
    # Python puts the current folder first: the data that lie there are not code of the suite.
    if not getattr(sys.flags, "safe_path", False):
        del sys.path[0]
    from iptm_core.program import main_of_module

    main_of_module()
