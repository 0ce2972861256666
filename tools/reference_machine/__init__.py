"""The reference machine: a 20 t excavator in MuJoCo with hydraulics, friction and sensors of its own.

It shares no code with cylforce, only the names of signals: an estimator that is accurate on its recordings is accurate
on a machine whose equations it does not contain. See `machine.draw` and `machine.Machine.run`."""

from .machine import Machine, draw
from .recording import Recording

__all__ = ["Machine", "Recording", "draw"]
