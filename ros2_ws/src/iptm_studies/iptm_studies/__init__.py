"""Closed loops without ROS over the same pure parts, and the studies made with them."""
