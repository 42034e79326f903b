"""Headless closed loop and studies over the same pure parts as the nodes, without ROS."""
