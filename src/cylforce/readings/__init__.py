"""Faults that the readings of a recording show without a model: differing clocks, frozen or exchanged sensors, jumps,
noise, vibration, and outlier references.
"""
