"""What the leader will do, as far as its messages tell, and how well that is known."""
