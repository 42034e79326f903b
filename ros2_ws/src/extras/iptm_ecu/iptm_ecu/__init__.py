"""The controller as C99 for a control unit."""
