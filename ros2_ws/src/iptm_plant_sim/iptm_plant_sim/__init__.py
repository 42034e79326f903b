"""The simulated vehicle: exact model, actuator limits and the node that runs it."""
