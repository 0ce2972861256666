"""Floor 1: the machine's frozen geometry."""
