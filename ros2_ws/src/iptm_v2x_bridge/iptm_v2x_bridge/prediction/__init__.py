"""Prediction of the leader's motion from its messages, with bounds."""
