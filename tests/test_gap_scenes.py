"""Single scenes, of one effect or of several: what is named, what stays without a name, what simulation refutes; and
two laws of friction by themselves. (Our own simulator: this shows that the programs work.)"""

from dataclasses import replace

import numpy as np
import pytest

from cylforce.diagnosis.answer import shrinkage
from cylforce.diagnosis.answer.fitting import Fitting
from cylforce.diagnosis.answer.located import insisted, located, next_cause, usual
from cylforce.diagnosis.answer.objections import of_simulation, weight_floor
from cylforce.diagnosis.answer.patch import patch
from cylforce.diagnosis.answer.shrinkage import gap, tried, written
from cylforce.diagnosis.answer.verdict import Judged, Search, Verdict, judged, searched
from cylforce.diagnosis.answer.where import Spot
from cylforce.diagnosis.inference import search
from cylforce.diagnosis.inference.candidates import quiet, showing
from cylforce.diagnosis.inference.found import Found
from cylforce.diagnosis.inference.posterior import NOTHING, UNKNOWN
from cylforce.diagnosis.inference.residuals import FOLDS, STEADY, clean, unforced
from cylforce.diagnosis.inference.search import examined
from cylforce.diagnosis.inference.sizes import plausible
from cylforce.effects.fault import BEYOND, INCIDENTAL, Place, TimeCourse, places
from cylforce.effects.friction.load_dependent_friction import LoadDependentFriction
from cylforce.effects.friction.presliding_hysteresis import PreslidingHysteresis
from cylforce.effects.imposed import Imposed, imposed
from cylforce.programs.common.gap_answer import reason
from gap_scene import MACHINE, Reference, as_it_was, recordings

SIGNALS = [signal.name for signal in MACHINE.signals]


@pytest.fixture(scope="module")
def reference() -> Reference:
    return as_it_was()


def looked_for(reference: Reference, effects: tuple[Imposed, ...] = (), change=None) -> Found:
    """Everything found in recordings of the machine with effects switched on, or with values changed."""
    field = recordings(2, effects)
    if change:
        field = [r._replace(values=change(r.values)) for r in field]
    return examined(reference.viewer, field, reference.clean, np.random.default_rng(1))


def concluded(reference: Reference, effects: tuple[Imposed, ...] = (), change=None) -> tuple[Search, Judged]:
    """The conclusion from all of that."""
    everything = looked_for(reference, effects, change)
    found = searched(everything)
    return found, judged(everything, found)


@pytest.fixture(scope="module")
def everything(reference) -> Found:
    """Of a machine whose stick has more friction."""
    return looked_for(reference, (imposed(MACHINE, "coulomb_friction", "stick", 2000.0),))


@pytest.fixture(scope="module")
def friction(everything) -> tuple[Search, Judged]:
    """The conclusion from it."""
    found = searched(everything)
    return found, judged(everything, found)


def test_a_machine_in_order_is_never_surely_out_of_order(reference):
    """No gap, or that in the set of what is possible: nothing is named alone."""
    found, verdict = concluded(reference)
    assert verdict.verdict in (Verdict.NO_GAP, Verdict.AMBIGUOUS)
    assert NOTHING in found.belief.credible
    assert sum(found.belief.of.values()) == pytest.approx(1.0)


@pytest.mark.parametrize(("late", "told"), [(0.4, False), pytest.param(3.0, True, marks=pytest.mark.long)])
def test_pressures_a_part_of_a_sample_late_are_everyday(reference, late, told):
    """Nodes take their readings when they like: from start to start they are up to a sample apart. What is later than
    that is a clock. (References and field alike had none between them.)"""
    own = [signal for name, signal in places(MACHINE, Place.PRESSURE)]

    def change(values):
        found, k = values.copy(), np.arange(len(values))
        for signal in own:
            found[:, signal] = np.interp(k - late, k, values[:, signal])
        return found

    found, _ = concluded(reference, change=change)
    of, clock = found.belief.of, ("clock_fault", "machine")
    assert (max(of, key=lambda key: of[key]) == clock) is told
    assert (of.get(clock, 0.0) > 0.1) is told


def test_a_jolt_or_two_do_not_hide_what_lasts(reference):
    """The boom is pushed for a second, twice: no more than references leave over all, but many nats in these blocks.
    The weak friction shows in all others."""

    def change(values):
        k = np.arange(len(values))
        jolts = sum(np.exp(-(((k - begin) / 40.0) ** 2)) for begin in (2200.0, 4700.0))
        found = values.copy()
        found[:, SIGNALS.index("boom_head_pressure")] += 1.5e5 * jolts
        return found

    effect = imposed(MACHINE, "viscous_friction", "stick", 3e3)
    found, _ = concluded(reference, (effect,), change)
    assert max(found.belief.of, key=found.belief.of.__getitem__) == ("viscous_friction", "stick")


def test_brief_hard_contacts_are_contact(reference, monkeypatch):
    """In one row a force at the teeth explains all three joints; over a block of three seconds no polynomial does, and
    what hid the machine there was called unknown. (That a load is known is no work either.)"""
    begins = (21.0, 24.3, 43.5, 130.2)
    hits = tuple(imposed(MACHINE, "soil_contact", "bucket", (2e4, -3e4), begin=b, end=b + 1.3) for b in begins)
    shares = []

    def seen(*given):
        shares.append(unforced(*given))
        return shares[-1]

    monkeypatch.setattr(search, "unforced", seen)
    found, verdict = concluded(reference, hits)
    assert not found.working
    assert [n.cause.key for n in verdict.named] == [("soil_contact", "bucket")]
    assert shares[0] < 0.1


def test_two_effects_are_both_named(reference):
    friction = imposed(MACHINE, "coulomb_friction", "stick", 4000.0)
    offset = imposed(MACHINE, "pressure_offset", "boom_rod_pressure", 4e5)
    found, verdict = concluded(reference, (friction, offset))
    listed = {n.cause.key for n in verdict.named} | {c.key for n in verdict.named for c in n.confused}
    assert ("coulomb_friction", "stick") in listed
    assert ("pressure_offset", "boom_rod_pressure") in {c.key for c in found.causes} | listed


def test_a_named_cause_is_simulated_and_dropped_if_that_does_not_help(friction):
    found, verdict = friction
    assert [n.cause.key for n in verdict.named] == [("coulomb_friction", "stick")]
    assert ("coulomb_friction", "stick") in {c.key for c in written(verdict)}
    _, after, size, doubt = tried(found, verdict, np.random.default_rng(1))
    assert (after, doubt) == (verdict, "")
    before, left = (rms[1] ** 2 - size.floor[1] ** 2 for rms in (size.fixed, size.after))
    assert 1.0 - left / before > 0.8
    assert np.sum(size.refit**2) <= np.sum(size.fixed**2)
    (named,) = verdict.named
    wrong = verdict._replace(named=(named._replace(cause=named.cause._replace(sizes=-named.cause.sizes)),))
    _, after, size, doubt = tried(found, wrong, np.random.default_rng(1))
    assert (after.verdict, after.named) == (Verdict.UNKNOWN, ())
    assert "coulomb_friction@stick" in doubt
    np.testing.assert_allclose(size.after, size.fixed)


def test_no_cause_that_lasts_is_asked_at_a_joint_without_a_gap(everything):
    """It would show there, however much evidence of it adds up over the recordings."""
    question, case = everything.question, everything.case
    found = searched(everything)
    still = quiet(question, found.at_rest((), found.fit.whole, clean(question).values))
    assert still == {0, 2}  # boom and bucket
    forms = range(len(question.forms))
    assert showing(question, case, forms, set()) == list(forms)
    asked = {question.forms[k][1][:2] for k in showing(question, case, forms, still)}
    assert ("coulomb_friction", "stick") in asked
    assert {("clock_fault", "machine"), ("angle_offset", "stick_angle")} <= asked
    assert asked.isdisjoint(
        {("coulomb_friction", "boom"), ("coulomb_friction", "bucket"), ("linkage_geometry", "bucket")}
    )
    assert {everything.asked.key(p) for h in everything.asked.hypotheses for p in h.which} <= {*asked, UNKNOWN}


def test_after_a_refutation_the_next_cause_is_asked(everything, friction):
    """Its probability is that without the refuted one; where no other cause is named, the gap stays unexplained."""
    (found, verdict), rng, true = friction, np.random.default_rng(1), ("coulomb_friction", "stick")
    rival = next(c.key for c in found.first if c.known and c.key != true)
    wrong = Judged(Verdict.UNKNOWN, (), verdict.explained, (rival,))
    search, after, size, doubt = next_cause(everything, (found, wrong, gap(found, (), rng), "refuted"), rng)
    assert [n.cause.key for n in after.named] == [true]
    assert (after.refuted, doubt) == ((rival,), "refuted")
    assert size.after[1] < 0.5 * size.fixed[1]
    assert rival not in search.belief.of
    assert sum(search.belief.of.values()) == pytest.approx(1.0)
    wrong = wrong._replace(refuted=(true,))
    search, after, _, _ = next_cause(everything, (found, wrong, gap(found, (), rng), "refuted"), rng)
    assert true not in {n.cause.key for n in after.named} | set(search.belief.of)
    assert after.named or after.verdict is Verdict.UNKNOWN
    assert after.refuted[0] == true
    tested = tried(found, verdict, rng)
    assert next_cause(everything, tested, rng) == tested


def test_one_wrong_cause_beside_it_does_not_withdraw_the_first(friction):
    """A poor reference lets effects beside the true one explain what it tells wrongly; simulated with these, the
    machine was farther off than before, and all was withdrawn."""
    found, verdict = friction
    first, rng = found.causes[0], np.random.default_rng(1)
    other = next(p for p in found.original.proposals if (p.name, p.at) == ("coulomb_friction", "boom"))
    places = tuple(found.original.places[found.original.proposals.index(other)])
    form = next(k for k, (p, _) in enumerate(found.question.forms) if p == other)
    sizes = np.array([[-9e4]])
    beside = first._replace(proposal=other, form=form, columns=places, sizes=sizes, errors=0.1 * sizes)
    both = verdict._replace(named=(*verdict.named, verdict.named[0]._replace(cause=beside)))
    wrong = found._replace(causes=(first, beside), fit=replace(found.fit, which=(*found.fit.which, form)))
    assert shrinkage.gap(wrong, (first, beside), rng).refuted
    _, after, size, doubt = tried(wrong, both, rng)
    assert [c.key for c in written(after)] == [first.key]
    assert ([n.cause.key for n in after.named], size.refuted, doubt) == ([first.key], False, "")


def test_a_size_larger_than_plausible_is_simulated_as_the_largest_that_is(friction):
    """An uncertain size may come out larger: it was left out, and what was not simulated took nothing away."""
    found, _ = friction
    cause, rng = found.causes[0], np.random.default_rng(1)
    column = found.question.forms[cause.form][1]
    largest = BEYOND * column.high
    assert plausible(column, np.array([-3.0 * largest])) == pytest.approx([-largest])
    assert plausible(column, np.array([0.5 * largest])) == pytest.approx([0.5 * largest])
    for size in rng.uniform(1.0, 100.0, 200) * largest:  # whatever is rounded, the simulator takes it
        assert imposed(MACHINE, *cause.key, float(plausible(column, np.array([size]))[0])).sizes
    before, most, more = (
        shrinkage.gap(found, causes, rng).after
        for causes in ((), *((cause._replace(sizes=cause.sizes * 0.0 + f * largest),) for f in (1.0, 3.0)))
    )
    np.testing.assert_allclose(more, most, rtol=1e-3)  # sizes of the folds differ a little
    assert most[1] > 1.5 * before[1]  # it is far more than the friction that there is


def test_what_other_stretches_tell_is_simulated_not_how_far_it_is_from_an_implausible_whole(friction, monkeypatch):
    """The whole recording tells three times the largest plausible size, a part of it half of that: the part counts."""
    found, _ = friction
    cause, whole = found.causes[0], found.fit.whole
    largest = BEYOND * found.question.forms[cause.form][1].high
    simulation = shrinkage.Simulation(found, (cause,))
    monkeypatch.setitem(whole.sizes, cause.form, np.array([3.0 * largest]))
    seen = cause._replace(sizes=np.array([[largest]]))
    for told, size in ((0.5, 0.5), (2.0, 1.0), (-0.5, -0.5)):
        part = whole._replace(sizes={cause.form: np.array([told * largest])})
        assert simulation._sized(seen, part).size == pytest.approx(size * largest)


def test_every_stretch_is_simulated_with_sizes_of_three_quarters_of_the_others(friction, monkeypatch):
    found, verdict = friction
    kept = []

    def told(self, blocks=None):
        kept.append(blocks)
        return whole(self, blocks)

    whole = Fitting.told
    monkeypatch.setattr(Fitting, "told", told)
    tried(found, verdict, np.random.default_rng(1))
    folds = np.array([blocks for blocks in kept if blocks is not None])
    assert folds.shape == (FOLDS, len(found.original.times))
    assert np.all(np.sum(~folds, axis=0) == 1)


def test_what_happens_at_moments_is_refuted_by_the_share_itself(friction, monkeypatch):
    """Its sizes are of the very blocks in which it is simulated: it takes away no more elsewhere. What lasts has its
    sizes from other stretches, and the interval counts."""
    (found, verdict), rng = friction, np.random.default_rng(1)
    monkeypatch.setattr(shrinkage, "closure", lambda *_: (0.2, (0.0, 0.6)))
    assert tried(found, verdict, rng)[3] == ""
    proposal = next(p for p in found.original.proposals if p.course is TimeCourse.WINDOWS and p.name == "soil_contact")
    blocks = np.eye(len(found.original.times))[:2]
    columns = tuple(found.original.places[found.original.proposals.index(proposal)])
    forces = np.full((2, len(columns)), 3e3)
    contact = found.causes[0]._replace(
        proposal=proposal, form=None, columns=columns, course=blocks, sizes=forces, errors=0.1 * forces
    )
    named = verdict._replace(named=(verdict.named[0]._replace(cause=contact),))
    _, after, _, doubt = tried(found._replace(causes=(contact,)), named, rng)
    assert (after.verdict, after.named) == (Verdict.UNKNOWN, ())
    assert "soil_contact@bucket" in doubt


def test_a_joint_that_differs_by_twice_the_floor_surely_has_a_gap(reference):
    """Where the torques differ from what is normal by as much, no machine is in order."""
    rng = np.random.default_rng(1)
    friction = imposed(MACHINE, "coulomb_friction", "stick", 700.0)
    everything = examined(reference.viewer, recordings(3, (friction,)), reference.clean, rng)
    search = searched(everything)
    tested, plain = tried(search, judged(everything, search), rng), gap(search, (), rng)
    assert search.belief.of[NOTHING] > 0.0
    spot = Spot("stick", "slow", 1.0, 0.5, 1.0, 0.001, found=True)
    large, small = (plain._replace(fixed=plain.floor * [1.0, x, 1.0]) for x in (2.03, 1.97))
    sure = insisted(everything, tested, large, [spot], rng)[0].belief.of
    assert NOTHING not in sure
    assert sum(sure.values()) == pytest.approx(1.0)
    for same, spots in (
        (small, [spot]),
        (large, [spot._replace(channel="boom")]),
        (large, [spot._replace(found=False)]),
    ):
        assert insisted(everything, tested, same, spots, rng) is tested


def test_the_gap_before_any_effect_knows_none(friction):
    """Where the loads hang is what leaves least, not what goes with a cause that may be wrong: beside one, a machine in
    order had a gap of 28 floors."""
    (found, verdict), rng = friction, np.random.default_rng(1)
    plain, named = gap(found, (), rng), tried(found, verdict, rng)[2]
    assert any(seen.recorded.load for seen in found.original.faulty)
    np.testing.assert_allclose(gap(found._replace(causes=()), (), rng).fixed, plain.fixed)
    energies = [sum(np.nansum((e / plain.floor) ** 2) for e in each.nominal) for each in (plain, named)]
    assert energies[0] < energies[1]
    np.testing.assert_allclose(plain.after, plain.fixed)


def test_a_second_cause_where_nothing_is_left_without_it_is_not_named(friction):
    """However many nats: it was another part of the first, or an everyday difference."""
    (found, verdict), rng = friction, np.random.default_rng(1)
    first = verdict.named[0]
    proposal = next(p for p in found.original.proposals if (p.name, p.at) == ("coulomb_friction", "bucket"))
    form = next(k for k, (p, _) in enumerate(found.question.forms) if p is proposal)
    columns = tuple(found.original.places[found.original.proposals.index(proposal)])
    second = first.cause._replace(proposal=proposal, form=form, columns=columns, probability=0.99)
    both = verdict._replace(named=(first, first._replace(cause=second, confidence=0.99)))
    fit = replace(found.fit, which=(first.cause.form, form))
    _, after, _, _ = tried(found._replace(causes=(first.cause, second), fit=fit), both, rng)
    assert [n.cause.key for n in after.named] == [first.cause.key]


def test_what_leaves_no_more_than_references_leave_of_each_other_is_no_gap(friction):
    """However sure its cause is: a delay of 0.9 floors was named with 90 %, and simulating it took nothing away."""
    (found, verdict), rng = friction, np.random.default_rng(1)
    (_, verdict, size, _), plain = tried(found, verdict, rng), gap(found, (), rng)
    assert not usual(found, plain)
    assert located(found, verdict, size, plain, []) == (found, verdict, size)
    small = plain._replace(fixed=1.04 * plain.floor)
    assert usual(found, small)
    assert usual(found, plain._replace(fixed=plain.floor * [1.0, 1.29, 1.0]))
    assert not usual(found, plain._replace(fixed=plain.floor * [1.0, 1.31, 1.0]))
    told, none, least = located(found, verdict, size, small, [])
    assert (none.verdict, none.named) == (Verdict.NO_GAP, ())
    assert least is small
    assert sum(told.belief.of.values()) == pytest.approx(1.0)
    assert told.belief.first == NOTHING
    spot = Spot("stick", "slow", 1.0, 0.5, 1.0, 0.001, found=True)
    assert located(found, verdict, size, small, [spot])[1] == verdict
    assert located(found, none, size, small, [spot])[1].verdict is Verdict.NOT_OBSERVABLE
    for floors, silent in ((1.97, Verdict.NO_GAP), (2.03, Verdict.NOT_OBSERVABLE)):  # never none at twice the floor
        large = plain._replace(fixed=floors * plain.floor)
        assert located(found, none, size, large, [])[1].verdict is silent
    rests = plain.floor * [0.0, 1.0, 1.0]  # a joint that no reference moves, nor this one
    assert located(found, none, size, plain._replace(fixed=2.03 * rests, floor=rests), [])[1].verdict is silent
    assert reason(found, []).startswith("the torques differ from")
    again = located(found, none, size, small, [spot._replace(found=False)])
    assert again == (told, none, small)
    assert not usual(found._replace(working=True), small)
    for course in (TimeCourse.WINDOWS, TimeCourse.CLOCK):
        other = next(p for p in found.original.proposals if p.course is course)
        assert not usual(found._replace(causes=(found.causes[0]._replace(proposal=other),)), small)


def mixed(values: np.ndarray) -> np.ndarray:
    """Three percent of the boom's pressure on the stick's line."""
    found = values.copy()
    found[:, SIGNALS.index("stick_rod_pressure")] += 0.03 * values[:, SIGNALS.index("boom_head_pressure")]
    return found


def rippled(values: np.ndarray) -> np.ndarray:
    """An angle sensor that errs in waves."""
    found, k = values.copy(), SIGNALS.index("stick_angle")
    found[:, k] += 0.02 * np.sin(15.0 * values[:, k])
    return found


@pytest.mark.parametrize("change", [mixed, pytest.param(rippled, marks=pytest.mark.long)])
def test_what_no_effect_of_the_library_makes_is_unknown(reference, change):
    assert concluded(reference, change=change)[1].verdict is Verdict.UNKNOWN


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


def test_what_no_force_at_the_teeth_explains(friction):
    """A force that is another one in every row leaves nothing, a torque at one joint most of it."""
    question, rng = friction[0].question, np.random.default_rng(3)
    (tips, push), floor = ([INCIDENTAL.index(name) for name in STEADY], [2e4, 1e4]), question.floor.rms
    none = [np.zeros(0, dtype=int)] * len(question.problem.faulty)
    forced, torque = [], []
    for seen in question.problem.faulty:
        columns = seen.rows.incidental[..., tips]
        forced.append(np.einsum("trk,tk->tr", columns, rng.standard_normal((len(columns), 2)) * push))
        torque.append(rng.standard_normal((len(columns), 3)) * floor * [100.0, 0.0, 0.0])
    assert unforced(question, forced, none) < 1e-6
    assert unforced(question, torque, none) > 0.5
    rows = [np.arange(len(e)) for e in torque]
    assert unforced(question, torque, rows) == 1.0  # nothing to explain


def named_so(friction, **changes) -> tuple[Search, Judged]:
    """The named cause with some values of it changed."""
    found, verdict = friction
    cause = verdict.named[0].cause._replace(**changes)
    return found._replace(causes=(cause,)), verdict._replace(named=(verdict.named[0]._replace(cause=cause),))


def test_a_magnitude_at_its_bound_or_an_interval_with_zero_is_not_named(friction):
    """Bucket linkages of 52 mm, the largest there are, were named on machines whose bucket shows no gap."""
    found, verdict = friction
    cause, rng = verdict.named[0].cause, np.random.default_rng(1)
    column = found.question.forms[cause.form][1]
    for changes, said in (
        ({"sizes": plausible(column, np.array([2.0 * BEYOND * column.high]))[None]}, "largest plausible"),
        ({"errors": np.abs(cause.sizes)}, "contains zero"),
    ):
        for working in (False, True):
            search, wrong = named_so(friction, **changes)
            _, after, _, doubt = tried(search._replace(working=working), wrong, rng)
            assert after.named == ()
            assert after.verdict is (Verdict.NOT_OBSERVABLE if working else Verdict.UNKNOWN)
            assert doubt.startswith("coulomb_friction@stick: ")
            assert said in doubt


def test_at_work_without_references_nothing_is_named(friction):
    """A machine in order that digs was "probably a bending stick"."""
    (found, verdict), rng = friction, np.random.default_rng(1)
    working = found._replace(working=True)
    assert tried(working, verdict, rng)[1].named == verdict.named
    alone = replace(found.question, problem=replace(found.original, clean=()))
    plain = found._replace(question=alone, working=True, fit=replace(found.fit, question=alone))
    assert tried(plain, verdict, rng)[1] == Judged(Verdict.NOT_OBSERVABLE, (), 0.0)


def test_a_closure_that_is_not_known_refutes(friction, monkeypatch):
    """NaN is less than nothing, and counted as closed."""
    monkeypatch.setattr(shrinkage, "closure", lambda *_: (np.nan, (np.nan, np.nan)))
    _, after, _, doubt = tried(*friction, np.random.default_rng(1))
    assert (after.verdict, after.named) == (Verdict.UNKNOWN, ())
    assert "hardly comes nearer" in doubt


def test_a_cause_that_makes_a_joint_or_the_weight_worse_is_not_named(friction):
    """A joint that a cause left 2.4 times worse was printed, and not questioned."""
    found, verdict = friction
    causes, floor = written(verdict), found.question.floor.rms
    usual = [np.broadcast_to(floor, seen.rows.left.shape) for seen in found.original.faulty]
    assert of_simulation(found, causes, usual, usual) == ""
    within, beyond = ([e * [1.0, 1.0, x] for e in usual] for x in (1.29, 2.4))
    assert of_simulation(found, causes, usual, within) == ""
    assert "the bucket differs more from the recordings than before" in of_simulation(found, causes, usual, beyond)
    # before: as much torque that weighs nothing, for it changes its sign half-way
    heavy = 2.0 * weight_floor(found.original, floor)
    mass = INCIDENTAL.index("load.mass")
    after = [heavy * seen.rows.incidental[..., mass] for seen in found.original.faulty]
    before = [e * np.where(np.arange(len(e)) < len(e) / 2, 1.0, -1.0)[:, None] for e in after]
    assert "weights are more wrong" in of_simulation(found, causes, before, after)
    assert of_simulation(found, causes, after, before) == ""


def test_what_is_simulated_beside_nothing_else_is_what_is_named(friction):
    """Causes that were not sure enough to be named stood in patch and simulation all the same."""
    found, verdict = friction
    first = verdict.named[0].cause
    proposal = next(p for p in found.original.proposals if (p.name, p.at) == ("coulomb_friction", "bucket"))
    form = next(k for k, (p, _) in enumerate(found.question.forms) if p is proposal)
    columns = tuple(found.original.places[found.original.proposals.index(proposal)])
    beside = first._replace(proposal=proposal, form=form, columns=columns, probability=0.3)
    both = found._replace(causes=(first, beside), fit=replace(found.fit, which=(first.form, form)))
    search, after, size, _ = tried(both, verdict, np.random.default_rng(1))
    assert [c.key for c in written(after)] == [n.cause.key for n in after.named] == [first.key]
    assert [block["name"] for block in patch(search, written(after))] == [first.key[0]]
    assert not size.refuted
