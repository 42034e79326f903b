"""Faults over ROS 2: an injector of messages, and nodes with faults inside."""
