"""Interaction force and payload weight of a hydraulic machine, from cylinder pressures and motion, over CANopen."""

import os

# Our matrices are small. BLAS threads gain nothing on them and, while another process keeps a core busy, wait for each
# other: identification took 20 times as long. One thread also adds in one order always. To be set before numpy loads.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"
