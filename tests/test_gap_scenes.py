"""Single scenes, of one effect or of several at once: what is named and what only listed, what comes first, what stays
without a name, which moments are set aside; and two laws of friction by themselves. (Our own simulator: this shows that
the programs work.)"""

import numpy as np
import pytest
from cylforce.diagnosis.rank import ranking
from cylforce.diagnosis.selection import together

from cylforce.diagnosis.answer import reason
from cylforce.diagnosis.correction import FADED, UNSURE_S, Applied, aside, unsure
from cylforce.diagnosis.diagnosis import asked, jumping, search
from cylforce.diagnosis.evidence import Evidence, Term
from cylforce.diagnosis.floor import noise_floor
from cylforce.diagnosis.problem import RARE, Option, Problem, looked_at
from cylforce.diagnosis.shrinkage import tried, written
from cylforce.diagnosis.unknown import UnknownTorque
from cylforce.diagnosis.verdict import CLEAR, STRONG, Verdict, judged
from cylforce.effects.friction.load_dependent_friction import LoadDependentFriction
from cylforce.effects.friction.presliding_hysteresis import PreslidingHysteresis
from cylforce.effects.geometry.backlash import Backlash
from cylforce.effects.imposed import Imposed, imposed
from cylforce.effects.library import proposals
from gap_scene import MACHINE, SERVICE, Reference, as_it_was, recordings

SIGNALS = [signal.name for signal in MACHINE.signals]


@pytest.fixture(scope="module")
def reference() -> Reference:
    return as_it_was()


def test_slewing_that_no_sensor_tells_is_named_beside_a_faint_touch(reference):
    """The touch has sizes enough to follow the slewing, too, but more of them."""
    turning = imposed(MACHINE, "slew_centrifugal", "machine", 0.2, begin=75.0, end=93.0)
    touch = imposed(MACHINE, "soil_contact", "bucket", [200.0, 300.0], begin=112.0, end=127.0)
    found = search(reference.viewer, recordings(2, (turning, touch)), reference.clean)
    first = judged(found).named[0].cause
    assert first.ranked.key == ("slew_centrifugal", "machine")
    weak = first._replace(score=0.5 * STRONG)
    for ahead, expected in ((2.0 * CLEAR, [first.ranked.key]), (0.5 * CLEAR, [])):
        doubted = found._replace(causes=(weak._replace(ahead=ahead),))  # where a touch tells as much
        assert [n.cause.ranked.key for n in judged(doubted).named] == expected


def test_an_asymmetry_larger_than_dry_friction_allows_is_another_cause(reference):
    """The same on that cylinder whichever way it moves: within what friction can have, it is named."""
    tares = dict(zip((q.name for q in reference.viewer.model.parameters), reference.viewer.tares, strict=True))
    dry = tares["bucket.coulomb"]
    for share, named in ((0.2, True), (0.9, False)):
        uneven = imposed(MACHINE, "asymmetric_friction", "bucket", share * dry)
        found = judged(search(reference.viewer, recordings(2, (uneven,)), reference.clean))
        listed = {r.key for n in found.named for r in (n.cause.ranked, *n.confused)}
        assert (("asymmetric_friction", "bucket") in listed) is named


def test_a_rival_must_be_farther_behind_where_the_form_does_not_fit(reference):
    friction = imposed(MACHINE, "coulomb_friction", "stick", 600.0)
    found = search(reference.viewer, recordings(2, (friction,)), reference.clean)
    first = judged(found).named[0].cause
    viscous = next(r for r in first.rivals if r.key[0] == "viscous_friction")
    score = 300.0  # nats
    for misfit, verdict in ((1.0, Verdict.EXPLAINED), (4.0, Verdict.AMBIGUOUS)):
        rival = viscous._replace(score=score - 12.0)
        cause = first._replace(score=score, inflation=misfit * first.usual, rivals=(rival,))
        assert judged(found._replace(causes=(cause,))).verdict is verdict


def test_one_force_at_the_teeth_is_told_not_a_torque_at_every_joint(reference):
    touch = imposed(MACHINE, "soil_contact", "bucket", [4000.0, 6000.0], begin=112.0, end=127.0)
    found = search(reference.viewer, recordings(2, (touch,)), reference.clean)
    problem, blocks, torques = found.original, found.original.blocks(found.floor), []
    for joint in ("stick", "bucket"):
        unknown = [p for p in problem.proposals if p.at == joint and isinstance(p.group[0], UnknownTorque)]
        torques += ranking(problem, Evidence(blocks, [r.option.term for r in torques]), unknown)
    assert [r.key for r in together(problem, blocks, torques)] == [("soil_contact", "bucket")]
    assert together(problem, blocks, torques[1:]) == torques[1:]


def problem_of(reference: Reference, *effects: Imposed) -> Problem:
    wanted, model = asked(MACHINE), reference.viewer.model
    seen = looked_at(reference.viewer, recordings(2, effects), wanted)
    return Problem(model, np.sqrt(np.diag(model.prior.covariance)), wanted, reference.clean, seen)


def test_strong_contact_is_asked_for_beside_a_faulty_sensor(reference):
    """The sensor's error is noticed in most blocks, but the contact in few much more."""
    touch = [
        imposed(MACHINE, "soil_contact", "bucket", force, begin=begin, end=begin + 6.0)
        for begin, force in ((12.0, [9e3, 15e3]), (96.0, [-9e3, 15e3]))
    ]
    offset = imposed(MACHINE, "pressure_offset", "bucket_head_pressure", 4e5)
    problem = problem_of(reference, *touch, offset)
    evidence = Evidence(problem.blocks(noise_floor(problem)))
    (option,) = problem.options(evidence, [p for p in problem.proposals if p.name == "soil_contact"])
    when = problem.times[np.any(option.term.course, axis=0)]
    assert np.sum((when > 11.0) & (when < 19.0)) >= 2
    assert len(when) <= RARE * len(problem.times)


def test_play_comes_before_what_follows_its_jumps(reference):
    """Where these are not looked at, nothing does better; a contact does better there, too."""
    play = imposed(MACHINE, "backlash", "stick", 0.02, shape={"turning": 1200.0, "crossing": 0.02})
    touch = imposed(MACHINE, "soil_contact", "bucket", [4000.0, 6000.0], begin=112.0, end=127.0)
    for effect, expected in ((play, [("backlash", "stick")]), (touch, [])):
        problem = problem_of(reference, effect)
        floor = noise_floor(problem)
        blocks = problem.blocks(floor)
        own, contact = ([p for p in problem.proposals if p.name == name] for name in ("backlash", "soil_contact"))
        jumps = next(r for r in ranking(problem, Evidence(blocks), own) if r.key[1] == "stick")
        free = jumps._replace(option=jumps.option._replace(proposal=contact[0]), score=2.0 * abs(jumps.score))
        first = [free, jumps]
        original = [seen.recorded for seen in problem.faulty]
        assert [r.key for r in jumping(reference.viewer, problem, floor, original, first)] == expected


def test_first_moments_are_no_rival_of_a_mass_of_its_own(reference):
    """They are nearly as good, for its own size tells little; but of exact form, as the mass."""
    mass = imposed(MACHINE, "extra_mass", "boom", [200.0, 300.0, 60.0, 500.0])
    (named,) = judged(search(reference.viewer, recordings(2, (mass,)), reference.clean)).named
    assert named.cause.ranked.key == ("extra_mass", "boom")
    assert ("first_moment_change", "boom") in {r.key for r in named.cause.rivals}
    assert ("first_moment_change", "boom") not in {r.key for r in named.confused}


SMALL = (
    ("soil_contact", "bucket", [200.0, 300.0], {"begin": 112.0, "end": 127.0}),
    ("viscous_friction", "stick", 1200.0, {}),
    ("coulomb_friction", "boom", 300.0, {}),
    ("pressure_offset", "boom_rod_pressure", 3e4, {}),
    ("friction_level_change", "bucket", 0.05, {}),
)


def test_many_small_causes_are_no_name_and_not_unknown(reference):
    """They do not hide one that stands out."""
    small = tuple(imposed(MACHINE, name, at, value, **more) for name, at, value, more in SMALL)
    found = search(reference.viewer, recordings(2, small), reference.clean)
    verdict = judged(found)
    assert (verdict.verdict, verdict.named) == (Verdict.NOT_OBSERVABLE, ())
    assert "none stands out: soil_contact at bucket, " in reason(found)
    friction = imposed(MACHINE, "coulomb_friction", "stick", 4000.0)
    named = judged(search(reference.viewer, recordings(2, (*small, friction)), reference.clean)).named
    assert [n.cause.ranked.key for n in named] == [("coulomb_friction", "stick")]


def test_what_is_large_of_its_kind_comes_before_what_says_more_and_is_small(reference):
    """Every machine has small ones, of which each says something."""
    friction = imposed(MACHINE, "coulomb_friction", "stick", 4000.0)
    offset = imposed(MACHINE, "pressure_offset", "boom_rod_pressure", 4e5)
    found = search(reference.viewer, recordings(2, (friction, offset)), reference.clean)
    plain = {c.ranked.key: c for c in found.causes if c.ranked.key[0] in ("coulomb_friction", "pressure_offset")}
    assert len(plain) == 2
    for large, small in (plain, reversed(plain)):
        sized = {large: (150.0, 10.0), small: (300.0, 1.0)}
        made = [
            c._replace(score=score, size=size * c.ranked.option.proposal.about.low, inflation=1.0, rivals=())
            for c, (score, size) in ((plain[key], sized[key]) for key in plain)
        ]
        assert judged(found._replace(causes=tuple(made))).named[0].cause.ranked.key == large


def test_bristles_keep_their_bend_where_a_sensor_is_noisy_at_rest():
    t, rng = np.arange(0.0, 12.0, 0.05), np.random.default_rng(3)
    law, noise = PreslidingHysteresis(way=0.001), np.diff(rng.normal(0.0, 5e-5, len(t) + 1)) / 0.05
    for way, lacking in ((1.0, 0.0), (-1.0, 2.0)):
        speed = np.where(t < 4.0, 0.005, np.where(t < 8.0, 0.0, way * 0.005)) + noise
        force = law.force(speed, np.zeros_like(t), t)
        assert abs(way * force[t >= 8.0][1] + lacking) < 0.7
        assert np.max(np.abs(force[t > 10.0])) < 0.05


def test_friction_that_saturates_grows_with_small_loads_alone():
    law, loads = LoadDependentFriction(easing=3e-6), np.array([1e3, -1e3, 1e8])
    force = law.force(np.full(3, 0.5), loads, np.arange(3.0))
    np.testing.assert_allclose(force, [1e3, 1e3, 1.0 / 3e-6], rtol=0.01)


@pytest.mark.parametrize(("late", "more"), [(0.08, 0.5), (0.15, 0.2), (0.01, 1.0)])
def test_friction_is_named_beside_clocks_that_are_apart(reference, late, more):
    """Much less than the clocks make, and much more."""
    clocks = imposed(MACHINE, "clock_fault", "machine", [late, 0.0], begin=40.0)
    friction = imposed(MACHINE, "friction_level_change", "stick", more)
    found = judged(search(reference.viewer, recordings(2, (clocks, friction)), reference.clean))
    assert {n.cause.ranked.key for n in found.named} >= {("clock_fault", "machine"), ("friction_level_change", "stick")}


def test_a_named_cause_is_simulated_and_dropped_if_that_does_not_help(reference):
    """A faint touch beside it is not simulated: it goes anywhere between the samples that tell it."""
    friction = imposed(MACHINE, "coulomb_friction", "stick", 2000.0)
    touch = imposed(MACHINE, "soil_contact", "bucket", [200.0, 300.0], begin=112.0, end=127.0)
    found = search(reference.viewer, recordings(2, (friction, touch)), reference.clean)
    verdict = judged(found)
    assert {("coulomb_friction", "stick"), ("soil_contact", "bucket")} <= {c.ranked.key for c in found.causes}
    assert [c.ranked.key for c in written(found, verdict)] == [("coulomb_friction", "stick")]
    after, size, doubt = tried(found, verdict, np.random.default_rng(1))
    assert (after, doubt) == (verdict, "")
    assert size.after[1] < 0.4 * size.fixed[1]
    before, left = (rms[1] ** 2 - size.floor[1] ** 2 for rms in (size.fixed, size.after))
    assert 1.0 - left / before > 0.8
    (named,) = verdict.named
    wrong = verdict._replace(named=(named._replace(cause=named.cause._replace(sizes=-named.cause.sizes)),))
    after, size, doubt = tried(found, wrong, np.random.default_rng(1))
    assert (after.verdict, after.named) == (Verdict.UNKNOWN, ())
    assert "coulomb_friction@stick" in doubt
    np.testing.assert_allclose(size.after, size.fixed)


def sprung(values: np.ndarray) -> np.ndarray:
    """A spring beside the boom's cylinder: its pressure goes with the boom's angle."""
    found, angle = values.copy(), values[:, SIGNALS.index("boom_angle")]
    found[:, SIGNALS.index("boom_head_pressure")] += 2e6 * np.tanh(3.0 * (angle - np.mean(angle)))
    return found


def mixed(values: np.ndarray) -> np.ndarray:
    """Three percent of the boom's pressure on the stick's line."""
    found = values.copy()
    found[:, SIGNALS.index("stick_rod_pressure")] += 0.03 * values[:, SIGNALS.index("boom_head_pressure")]
    return found


@pytest.mark.parametrize("change", [sprung, mixed])
def test_what_no_effect_of_the_library_makes_is_unknown(reference, change):
    field = [r._replace(values=change(r.values)) for r in recordings(2)]
    assert judged(search(reference.viewer, field, reference.clean)).verdict is Verdict.UNKNOWN


def test_the_moments_in_which_play_is_crossed_are_set_aside(reference):
    """About every jump, and nowhere else."""
    effect = imposed(MACHINE, "backlash", "bucket", 0.02)
    field = recordings(2, (effect,))
    problem = Problem(reference.viewer.model, np.ones(1), (), (), looked_at(reference.viewer, field, ()))
    (p,) = (p for p in proposals(MACHINE) if p.group[0] == Backlash(100.0) and p.at == "bucket")
    option = Option(p, "", Term((0,), np.ones((1, 1))), 0.0, p.about.high)
    touched = unsure(problem, reference.viewer, [Applied(option, np.array([0.02]))], field)
    for lost, seen, recorded in zip(touched, problem.faulty, field, strict=True):
        jumps = np.flatnonzero(Backlash(100.0).jumps(MACHINE, recorded.values, p.where)) / SERVICE.filters.rate_hz
        assert len(jumps) > 0
        off = np.min(np.abs(seen.rows.t[:, None] - recorded.begins - jumps), axis=1)
        assert np.all(lost[off < UNSURE_S])
        assert not np.any(lost[off > UNSURE_S + FADED * reference.viewer.lag])
        kept = aside(problem, touched).faulty[0].rows.left
        assert np.all(np.isnan(kept[touched[0]]))


def test_nothing_is_set_aside_where_little_would_be_left(reference):
    """A load whose sign changes twice a second."""
    field = [r._replace(values=r.values.copy()) for r in recordings(2)]
    pair = [SIGNALS.index("bucket_head_pressure"), SIGNALS.index("bucket_rod_pressure")]
    for recorded in field:
        turned = np.arange(len(recorded.values)) // 50 % 2 == 1
        recorded.values[:, pair] = np.where(turned[:, None], [0.0, 8e6], [8e6, 0.0])
    problem = Problem(reference.viewer.model, np.ones(1), (), (), looked_at(reference.viewer, field, ()))
    (p,) = (p for p in proposals(MACHINE) if p.group[0] == Backlash(100.0) and p.at == "bucket")
    applied = Applied(Option(p, "", Term((0,), np.ones((1, 1))), 0.0, p.about.high), np.array([0.02]))
    assert np.count_nonzero(np.diff(p.group[0].jumps(MACHINE, field[0].values, p.where))) > 100
    assert not any(np.any(lost) for lost in unsure(problem, reference.viewer, [applied], field))
