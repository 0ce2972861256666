"""Checks whether an arm can be built, and resembles that of a construction machine: they refuse or warn."""
