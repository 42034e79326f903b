"""Solver back ends behind one small interface; outcomes are data, never exceptions."""
