"""Effects as they are put into the reference machine."""
