"""Judges of ageing from outside of the suite: BLAST-Lite's cells and PyBaMM's mechanisms (an extra)."""
