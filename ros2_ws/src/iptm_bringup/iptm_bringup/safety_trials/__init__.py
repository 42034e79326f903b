"""The command of the safety trials, and those of them that are driven over ROS 2."""
