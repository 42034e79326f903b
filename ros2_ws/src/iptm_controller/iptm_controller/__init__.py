"""Multi-horizon model predictive control of power and temperature; only ``node`` depends on ROS."""
