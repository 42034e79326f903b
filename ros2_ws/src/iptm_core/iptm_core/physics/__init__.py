"""The physics of the paper, one effect per file, for floats, NumPy arrays and CasADi symbols alike."""
