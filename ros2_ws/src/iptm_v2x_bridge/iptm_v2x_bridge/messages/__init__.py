"""From a datagram to a message in SI units, or to the reason why there is none."""
