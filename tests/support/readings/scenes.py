"""Recordings of one simulated machine, empty and loaded, for tests of what readings show by themselves."""

import numpy as np

from cylforce.effects.imposed import Imposed
from cylforce.readings.recording import Recording
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.simulator import draw_truth
from scenarios import EXCAVATOR

SERVICE = load(EXCAVATOR).service
MACHINE = SERVICE.machine
SECONDS, LOADS = 70.0, (0.0, 1000.0)  # one recording empty, one with a known load; the house turns in both


def recordings(seed: int, effects: tuple[Imposed, ...] = ()) -> list[Recording]:
    """Return one run of one machine, empty and loaded, with motion and noise drawn from `seed`."""
    truth = draw_truth(MACHINE, np.random.default_rng(0), 0.1)._replace(effects=effects)
    scenes = [
        moves(MACHINE, np.random.default_rng((seed, k)), SECONDS, payload=payload, turning=True)
        for k, payload in enumerate(LOADS)
    ]
    made, rng = sensors(MACHINE, SERVICE.nodes), np.random.default_rng((seed, 9))
    records = run(MACHINE, truth, made, scenes, dt=1.0 / SERVICE.filters.rate_hz, rng=rng)
    return [Recording(f"{seed}", r.values, kg, float(r.t[0])) for r, kg in zip(records, LOADS, strict=True)]
