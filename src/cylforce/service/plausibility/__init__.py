"""Plausibility between sensors: detection of signals that contradict the others or themselves."""
