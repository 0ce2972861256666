"""Which motion to record next: distances between causes that mean what they say, and motions that decide."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from cylforce import diagnosis
from cylforce.diagnosis.decide import HypothesisEvidence
from cylforce.diagnosis.model import HealthyMachine, fitted_parameters, learnt
from cylforce.diagnosis.regressors import Regressors
from cylforce.diagnosis.search import NO_GAP, examined
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.imposed import imposed
from cylforce.effects.library import Proposal, proposals
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.loads.first_moment_change import FirstMomentChange
from cylforce.effects.sensors.pressure_gain import PressureGain
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.estimation.model import Model
from cylforce.programs.experiments.catalogue import catalogue, checkup
from cylforce.programs.experiments.separation import RivalCause, Separation, planned, sentences
from cylforce.readings.recording import Recording
from cylforce.readings.zeros import Zero
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import moves
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.simulator import draw_truth
from scenarios import CONFIG

SERVICE = load(CONFIG / "excavator_20t.toml").service
MACHINE = SERVICE.machine
LIBRARY = ((CoulombFriction(),), (PressureOffset(),), (PressureGain(),), (ExtraMass(),), (FirstMomentChange(),))


def recorded(name, seed, effects=(), seconds=60.0):
    truth = draw_truth(MACHINE, np.random.default_rng(0), 0.1)._replace(effects=effects)
    scene = moves(MACHINE, np.random.default_rng((seed, 1)), seconds)
    made, rng = sensors(MACHINE, SERVICE.nodes), np.random.default_rng((seed, 2))
    (record,) = run(MACHINE, truth, made, [scene], dt=1.0 / SERVICE.filters.rate_hz, rng=rng)
    return Recording(name, record.values)


@cache
def healthy() -> HealthyMachine:
    references = [recorded("first", 1), recorded("second", 2)]
    model = Model(MACHINE, SERVICE.filters, ("coulomb", "viscous", "delay"))
    regressors = Regressors(model, fitted_parameters(model, references))
    noise = np.array([s.standard_error for s in MACHINE.signals])
    return learnt(regressors, proposals(MACHINE, LIBRARY), references, noise, np.random.default_rng(1))


def diagnosed(*effects, zeros=None) -> HypothesisEvidence:
    field = [recorded("field", 3, effects)]
    question = diagnosis.question_of(healthy(), field, np.random.default_rng(1), zeros=zeros)
    return HypothesisEvidence(examined(question, lambda _: True))


class Abstract(Separation):
    """Causes whose information is given, in units of 1."""

    @property
    def unit(self):
        return np.ones(sum(len(rival.sizes) for rival in self.rivals))


def abstract(*rivals):
    return Abstract(SimpleNamespace(), rivals)


ONE = RivalCause(("friction", "stick"), 0.6, SimpleNamespace(), np.array([2.0]))
OTHER = RivalCause(("gain", "stick"), 0.3, SimpleNamespace(), np.array([3.0]))
NONE = RivalCause(NO_GAP, 0.1, None, np.zeros(0))


def test_orthogonal_signatures_are_as_far_apart_as_they_are_large():
    """4 * 25 and 9 * 16, the mean of both."""
    assert abstract(ONE, OTHER).information(np.diag([25.0, 16.0])) == pytest.approx((100.0 + 144.0) / 2.0)


def test_equal_signatures_are_not_separated():
    """One reproduces of the other all but what its prior forbids."""
    equal = 1e6 * np.ones((2, 2))
    assert abstract(ONE, OTHER).information(equal) < 20.0 < 1e-5 * 4.0 * equal[0, 0]


def test_a_fault_is_as_far_from_none_as_it_is_large():
    assert abstract(ONE, NONE).information(np.array([[25.0]])) == pytest.approx(100.0 / 2.0)


def test_the_rival_that_is_confused_most_counts():
    several = abstract(ONE, OTHER, NONE)
    information = np.array([[25.0, 19.9], [19.9, 16.0]])
    assert several.information(information) < abstract(ONE, NONE).information(information[:1, :1])


def proposal(name, at) -> Proposal:
    return next(p for p in healthy().layout.proposals if (p.name, p.at) == (name, at))


def separation(*causes) -> Separation:
    rivals = [RivalCause((p.name, p.at), 1.0 / len(causes), p, np.array(sizes)) for p, sizes in causes]
    return Separation(healthy(), tuple(rivals))


def test_a_known_load_separates_a_mass_from_the_scale_of_a_pressure_sensor():
    each = separation(
        (proposal("extra_mass", "stick"), [100.0, 150.0, 0.0, 225.0]),
        (proposal("pressure_gain", "boom_head_pressure"), [0.03]),
    )
    motions = {m.words: m for m in catalogue(MACHINE, ())}
    whole = "move all joints at once to and fro, each at a speed of its own"
    loaded = next(m for words, m in motions.items() if words.startswith(f"{whole}, carrying a known load"))
    assert each.distance(each.of(loaded), 0, 1) > each.distance(each.of(motions[whole]), 0, 1)


def test_the_whole_check_up_separates_more_than_a_short_motion():
    each = separation(
        (proposal("coulomb_friction", "stick"), [2e3]), (proposal("pressure_offset", "stick_head_pressure"), [1e5])
    )
    together, stairs = (each.of(motion) for motion in checkup(MACHINE))
    short = each.of(next(iter(catalogue(MACHINE, ()))))
    assert each.distance(together + stairs, 0, 1) > each.distance(short, 0, 1)


def test_the_advice_is_a_motion_that_separates_what_is_still_possible():
    plan = planned(diagnosed(imposed(MACHINE, "pressure_offset", "stick_head_pressure", 0.6e5)))
    for advice in plan.advice:
        assert advice.times > 0.0
        assert np.isfinite(advice.motion.scene.duration)
    assert [a.times for a in plan.advice] == sorted((a.times for a in plan.advice), reverse=True)
    assert all("twice as long" not in sentence for sentence in sentences(plan))
    assert plan.advice or plan.inseparable


def test_a_certain_cause_needs_no_motion():
    assert planned(diagnosed(imposed(MACHINE, "coulomb_friction", "stick", 6000.0))).advice == ()


def test_zeros_read_without_pressure_decide_between_the_two_sides_of_a_cylinder():
    """No motion separates them on this machine; the plan names both, and a reading without pressure decides.

    The offset is larger than what another temperature makes of a healthy sensor.
    """
    offset = imposed(MACHINE, "pressure_offset", "stick_head_pressure", 1.0e5)
    names = [s.name for s in MACHINE.signals]
    head, rod = (names.index(f"stick_{side}_pressure") for side in ("head", "rod"))
    places = [("pressure_offset", f"stick_{side}_pressure") for side in ("head", "rod")]
    unsure = diagnosed(offset)
    assert set(planned(unsure).inseparable) == set(places)
    sure = diagnosed(offset, zeros={head: Zero(1.0e5, 1e3), rod: Zero(0.0, 1e3)})
    assert sure.posterior[places[0]] > max(unsure.posterior[places[0]], 0.9)
    assert sure.posterior.get(places[1], 0.0) < 0.01 < unsure.posterior[places[1]]
