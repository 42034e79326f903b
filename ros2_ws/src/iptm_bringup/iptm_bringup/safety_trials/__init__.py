"""Command line of the safety trials, and their trials over ROS 2."""
