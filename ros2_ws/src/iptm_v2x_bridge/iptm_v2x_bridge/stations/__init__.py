"""Known stations, plausibility of their messages, and selection of the leader."""
