"""An operator of the simulated machine who does what the guidance tells him."""

import numpy as np

from cylforce.commissioning.reaches import Reach
from cylforce.commissioning.strokes import clear_range
from cylforce.mechanics.workspace import driven, stroke_time
from cylforce.simulation.scenario import of_joints
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.trajectory import JointCourse, Move, Phase, Scene
from scenarios import carried, truth_of

BRISK, QUICK = 0.25, 0.4  # m/s
RAMP = 0.7  # s to come to speed and to a halt


def commissioned(loaded, guide, seed, load=0.0, longest=400.0):
    """All advice given to the operator of machine `seed`, `load` [kg] in its bucket, until it is done or refused, and
    the samples (T, S) meanwhile."""
    service = loaded.service
    state, told, values = [guide.begin()], [], []

    def scenes():
        pose, rng = clear_range(service.machine).mean(axis=1), np.random.default_rng((seed, 7))
        while True:
            advice = guide.advice(state[0])
            told.append(advice)
            if advice.done or advice.refusal is not None or advice.seconds > longest:
                return
            for target, least in _targets(advice.stroke, rng.uniform(*clear_range(service.machine).T)):
                yield to_pose(service.machine, pose, target, least, carried(load) if load else None)
                pose = target

    made, rng = sensors(service.machine, service.nodes), np.random.default_rng((seed, 2))
    dt = 1.0 / service.filters.rate_hz
    for record in run(service.machine, truth_of(loaded, seed), made, scenes(), dt=dt, rng=rng):
        values.append(record.values)
        state[0] = guide.take(state[0], record.values)
    return told, np.concatenate(values)


def _targets(stroke, anywhere):
    """Postures to go to, each in at least so many seconds."""
    if stroke is None:
        return [(anywhere, 0.0)]
    if isinstance(stroke, Reach):
        return [(stroke.target, stroke.seconds)]
    begin, end = stroke.hold.copy(), stroke.hold.copy()
    begin[stroke.joint], end[stroke.joint] = stroke.begin, stroke.end
    return [(begin, 0.0), (end, stroke.seconds)]


def to_pose(machine, pose, target, least, dig):
    """All joints from `pose` to `target` (N,), in at least so many seconds; then a short rest."""
    joints, speed = driven(machine), QUICK if least else BRISK
    time = max(least, 0.3, *(stroke_time(machine, pose, j, float(target[j]), speed) for j in joints))
    courses = tuple(
        JointCourse(float(angle), _steady(0.1, time, float(target[j] - angle)) if j in joints else ())
        for j, angle in enumerate(pose)
    )
    return of_joints(machine, Scene(time + 0.3, courses, JointCourse(0.0), ((0.0, Phase.AIR),), dig))


def _steady(start, time, rise):
    """Steps that overlap by half, so that the speed in between hardly changes."""
    count = max(1, round(time / RAMP) - 1)
    length = 2.0 * time / (count + 1)
    return tuple(Move(start + k * length / 2, start + k * length / 2 + length, rise / count) for k in range(count))
