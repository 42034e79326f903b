"""Faults as data, and what they make of measurements, traffic, clock and solver, from outside."""
