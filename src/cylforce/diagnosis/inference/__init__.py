"""Hypotheses with their evidence, and what they make probable."""
