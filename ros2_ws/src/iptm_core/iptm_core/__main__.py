"""Run a program of the suite: `python -m iptm_core MODULE [ARGUMENTS]`."""

from iptm_core.program import main_of_module

if __name__ == "__main__":
    main_of_module()
