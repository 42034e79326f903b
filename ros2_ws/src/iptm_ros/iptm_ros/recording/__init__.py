"""Bags: recording, recovery, replay, reading and comparison of runs."""
