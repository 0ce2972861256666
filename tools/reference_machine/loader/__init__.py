"""The reference wheel loader: Z-bar bodies in closed loops, on a base that drives and rocks. It shares no code with
cylforce; hydraulics, friction and sensors are those of the reference excavator. See `machine.draw`."""

from .machine import Loader, draw

__all__ = ["Loader", "draw"]
