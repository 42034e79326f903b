"""The saving for real cars on measured trips, and what a simpler model of the controller costs."""
