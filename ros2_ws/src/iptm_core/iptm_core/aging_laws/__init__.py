"""Ageing laws of cells: one interface, the paper's law, and published calendar and cyclic laws."""
