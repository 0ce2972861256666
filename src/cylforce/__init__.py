"""Interaction force and payload weight of a hydraulic machine, from cylinder pressures and motion, over CANopen."""

__version__ = "0.1.0"
