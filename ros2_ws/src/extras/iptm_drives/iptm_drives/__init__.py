"""Drives as the field writes them: GPX, FCD, CAN, MF4, bags, tables of other programs."""
