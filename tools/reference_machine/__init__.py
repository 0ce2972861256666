"""The reference machine: a 20 t excavator in MuJoCo with hydraulics, friction and sensors of its own.

It shares no code with cylforce, only the names of signals: what an estimator reaches on its recordings is reached on a
machine whose author it does not know. See `machine.draw` and `machine.Machine.run`.
"""

from .machine import Machine, draw
from .recording import Recording

__all__ = ["Machine", "Recording", "draw"]
