"""Checks whether an arm can be built, and looks like that of a construction machine: they refuse or warn."""
