"""Figures of the report, drawn with matplotlib without a display."""
