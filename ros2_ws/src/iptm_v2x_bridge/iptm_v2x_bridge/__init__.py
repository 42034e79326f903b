"""What the host learns about the road ahead: the leader, its predicted motion, the slope."""
