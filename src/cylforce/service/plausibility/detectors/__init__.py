"""Detectors: each tests for one way in which signals contradict each other or themselves. `table.py` lists them."""
