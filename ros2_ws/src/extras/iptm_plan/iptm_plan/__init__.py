"""Plan of the day: when to charge, how far, and the price of a kelvin at departure and arrival (an extra)."""

PROGRAM = "iptm plan"
