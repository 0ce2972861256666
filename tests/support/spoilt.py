"""Commissioning moves of the simulated machine that should have been empty, free and well wired."""

from dataclasses import replace

import numpy as np

from cylforce.estimation.model import Model
from cylforce.simulation import simulator
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from scenarios import carried, truth_of

SECONDS = 100.0


def samples(loaded, seed, load=0.0, seconds=SECONDS):
    """Samples (T, S) of the moves of machine `seed`, `load` [kg] in its bucket all the time."""
    service = loaded.service
    scene = moves(service.machine, np.random.default_rng((seed, 1)), seconds)
    scene = scene._replace(dig=carried(load)) if load else scene
    made, rng = sensors(service.machine, service.nodes), np.random.default_rng((seed, 2))
    records = run(service.machine, truth_of(loaded, seed), made, [scene], dt=1.0 / service.filters.rate_hz, rng=rng)
    return np.concatenate([record.values for record in records])


def touching(monkeypatch, share, newtons):
    """From now on ground carries the tool wherever it is lower than the quantile `share` of its heights, with up to
    `newtons` upwards and a third of that against its way."""
    free = simulator.tip_torque

    def on_the_ground(machine, moving, force):
        tip = np.sum(np.exp(1j * moving.q) * np.append(machine.lengths[:-1], machine.tool), axis=-1)
        up = np.clip((np.quantile(tip.imag, share) - tip.imag) / 0.1, 0.0, 1.0) * newtons
        along = -0.3 * up * np.tanh(np.gradient(tip.real) / 1e-3)
        return free(machine, moving, force + np.stack([along, up], axis=-1))

    monkeypatch.setattr(simulator, "tip_torque", on_the_ground)


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
