"""Plausibility between sensors: which signal the others contradict."""
