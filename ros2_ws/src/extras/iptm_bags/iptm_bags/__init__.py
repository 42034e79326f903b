"""Sound bags of those that were killed, cut short or damaged."""
