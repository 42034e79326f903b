"""From a datagram to a message in SI units, or to the reason for its rejection."""
