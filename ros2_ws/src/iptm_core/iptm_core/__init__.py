"""The model of the integrated power and thermal management system, free of ROS."""
