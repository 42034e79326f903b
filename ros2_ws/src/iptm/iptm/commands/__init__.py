"""Commands of the program `iptm`; modules load what they need only when they run."""
