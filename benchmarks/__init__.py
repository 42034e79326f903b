"""Measurements of solver and closed loop; run by ``scripts/benchmark``, never by the tests."""
