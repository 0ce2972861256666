"""Intervals of shares, for studies and trials."""
