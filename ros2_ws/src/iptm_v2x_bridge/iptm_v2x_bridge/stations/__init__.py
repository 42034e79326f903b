"""Which stations there are, which of their messages are plausible, and which one leads."""
