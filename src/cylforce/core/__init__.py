"""Floor 4: the service as a pure function of events, the simulator, identification."""
