"""Cabin, heat pump, radiator and pack on one compressor."""
