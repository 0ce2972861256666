"""Floor 5: the only impure one: clock, bus, CANopen node, files, settings."""
