"""Floor 6: the programs, one command each."""
