"""The physics of the paper, each equation written once, for floats, NumPy arrays and CasADi symbols alike."""
