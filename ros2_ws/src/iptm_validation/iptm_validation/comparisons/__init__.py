"""Figures, curves and texts of each comparison with measurements."""
