"""Commissioning moves of the simulated machine that should have been empty, free and well wired."""

from dataclasses import dataclass, replace

import numpy as np

from cylforce.effects.fault import About, Place
from cylforce.effects.imposed import Imposed
from cylforce.effects.loads.tip_force import tip_torque
from cylforce.estimation.model import Model
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from scenarios import carried, truth_of

SECONDS = 100.0


def samples(loaded, seed, load=0.0, seconds=SECONDS, effects=()):
    """Samples (T, S) of the moves of machine `seed` with `effects`, `load` [kg] in its bucket all the time."""
    service = loaded.service
    scene = moves(service.machine, np.random.default_rng((seed, 1)), seconds)
    scene = scene._replace(dig=carried(load)) if load else scene
    made, rng = sensors(service.machine, service.nodes), np.random.default_rng((seed, 2))
    truth = truth_of(loaded, seed)._replace(effects=effects)
    records = run(service.machine, truth, made, [scene], dt=1.0 / service.filters.rate_hz, rng=rng)
    return np.concatenate([record.values for record in records])


@dataclass(frozen=True)
class Ground:
    """Ground that carries the tool: the size is the largest force upwards [N], a third of it acts against the motion.

    share: quantile of the tool's heights below which the tool touches it
    """

    share: float

    @property
    def about(self):
        """Description of the effect."""
        return About("ground", "N", 1e3, 1e5, Place.MACHINE, "where the tool is low", "lift the tool")

    def torque(self, machine, moving, t, where):
        """Torques (T, N) that the cylinders supply in addition, per unit of size."""
        tip = np.sum(np.exp(1j * moving.q) * np.append(machine.lengths[:-1], machine.tool), axis=-1)
        up = np.clip((np.quantile(tip.imag, self.share) - tip.imag) / 0.1, 0.0, 1.0)
        along = -0.3 * up * np.tanh(np.gradient(tip.real) / 1e-3)
        return tip_torque(machine, moving, np.stack([along, up], axis=-1))


def touching(share, newtons):
    """The ground as an effect on the simulated machine."""
    return (Imposed((Ground(share),), "machine", 0, (newtons,)),)


def exchanged(values, first, second):
    """Samples with the columns `first` and `second` exchanged."""
    found = values.copy()
    found[:, first + second] = values[:, second + first]
    return found


def with_bore(model, c, factor):
    """The model of a machine file that gives cylinder `c` another bore."""
    cylinders = list(model.machine.cylinders)
    head, rod = cylinders[c].area_head * factor**2, cylinders[c].area_head - cylinders[c].area_rod
    cylinders[c] = replace(cylinders[c], area_head=head, area_rod=head - rod)
    return Model(replace(model.machine, cylinders=tuple(cylinders)), model.filters, model.friction)
