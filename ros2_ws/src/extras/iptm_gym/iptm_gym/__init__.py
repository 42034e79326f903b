"""Trips as environments of Gymnasium (an extra): `environment`, wrappers in `parts`, the reward in `cost`."""
