"""Plausibility between sensors: detection of signals that contradict the others or themselves.

Work in `detectors` to add or change a detector; `table.py` lists them. The other files are what detectors share.
"""
