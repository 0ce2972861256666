"""More data never makes a diagnosis worse: a check-up beside a first recording keeps what that recording showed."""

from functools import cache

import numpy as np
import pytest

from cylforce import diagnosis
from cylforce.diagnosis.decide import HypothesisEvidence
from cylforce.diagnosis.model import HealthyMachine, fitted_parameters, learnt
from cylforce.diagnosis.regressors import Regressors
from cylforce.diagnosis.search import NO_GAP, examined
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.friction.viscous_friction import ViscousFriction
from cylforce.effects.geometry.linkage_geometry import LinkageGeometry
from cylforce.effects.imposed import Imposed, imposed
from cylforce.effects.library import proposals
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.sensors.angle_offset import AngleOffset
from cylforce.effects.sensors.pressure_gain import PressureGain
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.estimation.model import Model
from cylforce.programs.experiments.catalogue import checkup
from cylforce.readings.recording import Recording
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.simulator import draw_truth
from cylforce.simulation.trajectory import Scene
from scenarios import CONFIG

SERVICE = load(CONFIG / "excavator_20t.toml").service
MACHINE = SERVICE.machine
LIBRARY = (
    (CoulombFriction(),),
    (ViscousFriction(),),
    (PressureOffset(),),
    (PressureGain(),),
    (AngleOffset(),),
    (LinkageGeometry(0), LinkageGeometry(0, across=True)),
    (ExtraMass(),),
)
NOISE = 0.1  # of a probability: what another realisation of the sensors' noise changes


def recorded(name: str, seed: int, scene: Scene, effects: tuple[Imposed, ...] = ()) -> Recording:
    truth = draw_truth(MACHINE, np.random.default_rng(0), 0.1)._replace(effects=effects)
    made, rng = sensors(MACHINE, SERVICE.nodes), np.random.default_rng((seed, 2))
    (record,) = run(MACHINE, truth, made, [scene], dt=1.0 / SERVICE.filters.rate_hz, rng=rng)
    return Recording(name, record.values)


def strokes(seed: int) -> Scene:
    return moves(MACHINE, np.random.default_rng((seed, 1)), 60.0)


@cache
def healthy() -> HealthyMachine:
    references = [recorded("first", 1, strokes(1)), recorded("second", 2, checkup(MACHINE)[0].scene)]
    model = Model(MACHINE, SERVICE.filters, ("coulomb", "viscous", "delay"))
    regressors = Regressors(model, fitted_parameters(model, references))
    noise = np.array([s.standard_error for s in MACHINE.signals])
    return learnt(regressors, proposals(MACHINE, LIBRARY), references, noise, np.random.default_rng(1))


def posterior(*recordings: Recording) -> dict[tuple[str, str], float]:
    question = diagnosis.question_of(healthy(), recordings, np.random.default_rng(1))
    return HypothesisEvidence(examined(question, lambda _: True)).posterior


MASS = ("extra_mass", "stick", (120.0, 180.0, 0.0, 270.0))
KINDS = {
    "friction": ("coulomb_friction", "stick", 3000.0),
    "sensor": ("angle_offset", "stick_angle", 0.01),
    "geometry": ("linkage_geometry", "bucket", (0.01, 0.0)),
    "mass": MASS,
    "healthy": None,
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_check_up_beside_a_recording_keeps_what_the_recording_showed(kind):
    fault = KINDS[kind]
    effects = () if fault is None else (imposed(MACHINE, *fault),)
    truth = NO_GAP if fault is None else fault[:2]
    field = recorded("field", 3, strokes(3), effects)
    steps = [recorded(f"step_{k}", 4 + k, motion.scene, effects) for k, motion in enumerate(checkup(MACHINE))]
    before, after = posterior(field), posterior(field, *steps)
    assert max(before, key=lambda k: before[k]) != truth or max(after, key=lambda k: after[k]) == truth, (before, after)
    assert after.get(truth, 0.0) >= before.get(truth, 0.0) - NOISE, (before, after)
