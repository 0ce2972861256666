"""One simulated machine, recorded empty and loaded: as it always was, or with effects switched on."""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.columns.floor import fitted_tares
from cylforce.diagnosis.columns.problem import Seen, looked_at
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.diagnosis.inference.search import asked
from cylforce.effects.imposed import Imposed
from cylforce.estimation.model import FRICTION, Model
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.simulator import draw_truth

SERVICE = load(Path(__file__).resolve().parents[1] / "config/excavator_20t.toml").service
MACHINE = SERVICE.machine
SECONDS, LOADS = 70.0, (0.0, 1000.0)  # one recording empty, one with a known load; the house turns in both


def recordings(seed: int, effects: tuple[Imposed, ...] = ()) -> list[Recorded]:
    """One run of one machine, empty and loaded, with motion and noise drawn from `seed`."""
    truth = draw_truth(MACHINE, np.random.default_rng(0), 0.1)._replace(effects=effects)
    scenes = [
        moves(MACHINE, np.random.default_rng((seed, k)), SECONDS, payload=payload, turning=True)
        for k, payload in enumerate(LOADS)
    ]
    made, rng = sensors(MACHINE, SERVICE.nodes), np.random.default_rng((seed, 9))
    records = run(MACHINE, truth, made, scenes, dt=1.0 / SERVICE.filters.rate_hz, rng=rng)
    return [Recorded(f"{seed}", r.values, kg, float(r.t[0])) for r, kg in zip(records, LOADS, strict=True)]


class Reference(NamedTuple):
    viewer: Viewer
    clean: tuple[Seen, ...]


@cache
def as_it_was() -> Reference:
    """The machine as it always was; made once, whatever the number of files that ask for it."""
    clean, model = recordings(1), Model(MACHINE, SERVICE.filters, FRICTION)
    viewer = Viewer(model, fitted_tares(model, clean))
    return Reference(viewer, looked_at(viewer, clean, asked(MACHINE)))
