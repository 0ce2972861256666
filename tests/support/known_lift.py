"""A lift of a known weight by a simulated machine."""

import numpy as np

from cylforce.simulation.scenario import posture_at
from cylforce.simulation.sensing import run, sensors
from scenarios import scene, truth_of

KNOWN_KG, SECONDS = 1000.0, 20.0


def lifted(loaded):
    """Samples (T, S) of a weight that hangs while all joints move to and fro."""
    service = loaded.service
    strokes = [
        (j, t, t + 3.8, size * (-1) ** k)
        for j, size in enumerate((0.3, 0.35, 0.4))
        for k, t in enumerate(np.arange(0.2 + 1.3 * j, SECONDS - 4.0, 4.0))
    ]
    begin = posture_at(service.machine, (0.5, 0.6, 0.6))
    made, rng = sensors(service.machine, service.nodes), np.random.default_rng(5)
    scenes = [scene(begin, strokes, SECONDS, KNOWN_KG)]
    return np.concatenate([r.values for r in run(service.machine, truth_of(loaded), made, scenes, dt=0.01, rng=rng)])
