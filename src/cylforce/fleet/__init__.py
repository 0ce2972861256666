"""Many machines: statistics of each recording, which machine changed and when, and the usual spreads of a type."""
