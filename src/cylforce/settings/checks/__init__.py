"""Whether an arm can be built, and looks like that of a construction machine: refuses or warns."""
