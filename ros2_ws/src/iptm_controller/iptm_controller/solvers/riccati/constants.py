"""Constants of the interior-point method in ``c/riccati.c``, with the symbols of their source.

WB stands for Waechter and Biegler (2006), NW for Nocedal and Wright (2006). The steps of the method are in
docs/explanation/optimal-control.md.
"""

FRACTION_TO_BOUNDARY = 0.995
"""tau, NW eq. 19.9."""
LEAST_SLACK = 1e-3
"""Of a hard constraint in the first iterate."""

COLD_START_BARRIER = 10.0
COLD_START_SAFEGUARD = 0.03
"""Share of the residuals that the barrier parameter of a cold start does not fall below."""

BACKTRACKING = 0.3
MAX_TRIALS = 3
MAX_REGULARISATIONS = 12
FIRST_REGULARISATION = 1e-3
REGULARISATION_FACTOR = 8.0
LEAST_REGULARISATION = 1e-5

MARGIN = 1e-5  # gamma_theta and gamma_phi of WB
ARMIJO = 1e-4  # eta_phi
SWITCHING_SLOPE_EXPONENT = 2.3  # s_phi
SWITCHING_VIOLATION_EXPONENT = 1.1  # s_theta
MAX_VIOLATION_FACTOR = 1e4  # theta_max relative to the first point
MIN_VIOLATION_FACTOR = 1e-4  # theta_min relative to the first point
ROUND_OFF = 1e-10

MULTIPLIER_SCALE = 100.0  # s_max of WB eq. 5
CENTRING_EXPONENT = 3  # of Mehrotra's rule, NW eq. 14.34
LEAST_BARRIER = 0.05
"""Smallest barrier parameter, relative to the tolerance."""
LEAST_PRIMAL_STEP = 0.01
"""Shortest affine-scaling step that is used where pivots were corrected."""
