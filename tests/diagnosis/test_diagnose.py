"""The whole diagnosis of a simulated machine beside two recordings of it while it was healthy."""

from dataclasses import replace

import numpy as np
import pytest

from cylforce.diagnosis import concluded, diagnose, single_effect
from cylforce.diagnosis.decide import Verdict
from cylforce.diagnosis.likelihood import Conditions
from cylforce.diagnosis.search import NO_GAP, UNKNOWN
from cylforce.effects.library import LIBRARY, proposals
from cylforce.readings.constants import HALF
from diagnosis.scenes import (
    MACHINE,
    PROPOSALS,
    REFERENCE_SEEDS,
    diagnosed,
    dug,
    effect,
    healthy_machine,
    learnt_from,
    names,
    recorded,
)

FIELD, CHECK_UP = 5, 6  # seeds of recordings that nothing was learnt from
SIGNALS = [s.name for s in MACHINE.signals]

FAULTS = [
    effect("coulomb_friction", "stick", 2500.0),
    effect("viscous_friction", "stick", 3e4),
    effect("angle_offset", "stick_angle", 0.02),
    effect("pressure_gain", "stick_head_pressure", 0.06),
    effect("sensor_delay", "stick_angle", 0.05),
    effect("linkage_geometry", "stick", [0.03, 0.01], shape={"part": 1}),
    effect("extra_mass", "stick", [200.0, 300.0, 60.0, 500.0]),
    effect("extra_mass", "bucket", [120.0, 90.0, 30.0, 90.0]),
    effect("hose_spring", "stick", 2500.0),
    effect("return_line_loss", "stick", [3e4, 1e4]),
]
SAME = {"extra_mass": "first_moment_change", "first_moment_change": "extra_mass"}


@pytest.mark.parametrize("seed", [FIELD, CHECK_UP])
def test_a_healthy_machine_has_no_gap(seed):
    found = diagnosed((seed, ()))
    assert (found.verdict, names(found)) == (Verdict.NO_GAP, [])
    assert found.evidence.first == NO_GAP
    assert sum(found.evidence.posterior.values()) == pytest.approx(1.0)
    assert not any(spot.found for spot in found.spots)


def test_oil_of_another_temperature_is_no_fault():
    """More friction in every cylinder is colder oil; in one cylinder alone it is a fault of that one."""
    sizes = {("viscous_friction", "stick"): 1e4, ("viscous_friction", "bucket"): 8e3}
    sizes |= {("coulomb_friction", "stick"): 1200.0, ("coulomb_friction", "bucket"): 1000.0}
    colder = tuple(effect(*key, size) for key, size in sizes.items())
    found = diagnosed((FIELD, colder))
    assert (found.verdict, names(found)) == (Verdict.NO_GAP, [])
    assert found.other_temperature
    assert not diagnosed((FIELD, ())).other_temperature


def test_cold_oil_that_warms_is_no_fault():
    """The friction of all cylinders falls together; a loss in the lines of one is a fault in cold oil, too."""
    drift = "friction_temperature_drift"
    wanted = (*PROPOSALS, *proposals(MACHINE, tuple(g for g in LIBRARY if g[0].about.name == drift)))
    machine = learnt_from(*(recorded(seed) for seed in REFERENCE_SEEDS), wanted=wanted)

    def found(*effects):
        return diagnose(machine, [recorded(FIELD, *effects)], np.random.default_rng(1))

    sizes = {("viscous_friction", "stick"): 1e4, ("viscous_friction", "bucket"): 8e3}
    sizes |= {("coulomb_friction", "stick"): 1200.0, ("coulomb_friction", "bucket"): 1000.0}
    colder = tuple(effect(*key, size) for key, size in sizes.items())
    cold = found(*colder, effect(drift, "machine", -0.8, shape={"settling": 60.0}))
    assert (cold.verdict, names(cold)) == (Verdict.NO_GAP, [])
    assert cold.other_temperature
    loss = ("return_line_loss", "stick")
    assert names(found(*colder, effect(*loss, [1e4, 3e3])))[0] == loss


def test_a_simulation_refits_what_oil_changes_only_where_the_oil_is_another():
    question = replace(diagnosed((FIELD, ())).evidence.found.question, same_oil=False)
    warmth = [None, 0.0, 0.3, 1.0]
    assert [question.refits(Conditions(temperature=t)) for t in warmth] == [False, False, True, True]
    assert not question.with_same_oil().refits(Conditions(temperature=1.0))


def test_a_cause_by_itself_has_the_size_and_error_of_the_conditions_under_which_it_is_simulated():
    """The friction of one cylinder is hardly known where all friction may be another."""
    found = diagnosed((FIELD, (FAULTS[0], effect("angle_offset", "bucket_angle", 0.05))))
    key = (FAULTS[0].group[0].about.name, FAULTS[0].at)
    (best,) = [c for c in found.evidence.candidates if c.keys == {key}][:1]
    noise = replace(best.hypothesis.noise, conditions=Conditions(temperature=1.0))
    warm = replace(best, hypothesis=replace(best.hypothesis, noise=noise))
    plain, other = (single_effect(found.evidence, key, each).hypothesis for each in (best, warm))
    assert other.noise.conditions.other_oil
    assert other.errors[0] > 3.0 * plain.errors[0]


def test_no_gap_is_not_said_where_the_references_differ_as_much_as_the_recording():
    """Still postures predict no motion: what moves differs visibly then, and no effect may be its cause here."""
    plain = healthy_machine()
    torn = replace(plain, floor_unseen=plain.floor.rms**2 * np.repeat([[1.0], [900.0]], 2, axis=0))
    field = [recorded(FIELD, effect("coulomb_friction", "stick", 1500.0))]

    def found(machine):
        return diagnose(machine, field, np.random.default_rng(1), lambda _: False)

    assert found(torn).evidence.gap < np.sqrt(1.0 + torn.spread)
    assert found(torn).verdict is Verdict.NOT_OBSERVABLE
    assert found(plain).verdict is Verdict.UNKNOWN


def test_zeros_of_all_pressure_sensors_at_another_temperature_are_no_fault():
    sensors = ("stick_head_pressure", "stick_rod_pressure", "bucket_head_pressure", "bucket_rod_pressure")
    zeros = zip(sensors, (0.4e5, -0.3e5, -0.5e5, 0.4e5), strict=True)
    found = diagnosed((FIELD, tuple(effect("pressure_offset", at, size) for at, size in zeros)))
    assert (found.verdict, names(found)) == (Verdict.NO_GAP, [])


@pytest.mark.parametrize("fault", FAULTS, ids=lambda f: f"{f.group[0].about.name}@{f.at}")
def test_a_visible_effect_is_named_first_with_its_magnitude(fault):
    true = (fault.group[0].about.name, fault.at)
    found = diagnosed((FIELD, (fault,)))
    assert found.verdict in (Verdict.EXPLAINED, Verdict.AMBIGUOUS)
    key = names(found)[0]
    assert key == true or (SAME.get(key[0]), key[1]) == true, (names(found), found.evidence.posterior)
    assert found.simulated.share[0] > 0.9
    (first, *_) = found.named
    if key == true:
        (_, low, high), about = first.cause.interval, fault.group[0].about
        size = float(np.linalg.norm(fault.sizes[: about.axes])) if about.axes > 1 else fault.sizes[0]
        width = 2.5 * (high - low)  # four standard errors to either side, and the error of the law
        assert low - width / 2.0 < size < high + width / 2.0, (first.cause.interval, size)


@pytest.mark.xfail(
    strict=True, reason="0.102 s instead of 0.080 s: the refitted parameters take up what a delay leaves"
)
def test_a_delay_of_the_bucket_is_named_with_its_magnitude():
    found = diagnosed((FIELD, (effect("sensor_delay", "bucket_angle", 0.08),)))
    assert names(found)[0] == ("sensor_delay", "bucket_angle")
    assert found.named[0].cause.interval[0] == pytest.approx(0.08, rel=0.1)


def test_the_answer_is_consistent():
    found = diagnosed((FIELD, (FAULTS[0],)))
    (first, *_) = found.named
    assert first.confidence == found.evidence.posterior[first.cause.key]
    assert sum(named.share for named in found.named) == pytest.approx(1.0)
    assert first.cause.key not in first.rivals
    assert found.evidence.credible[0] == first.cause.key
    assert np.all(np.diff([named.confidence for named in found.named]) <= 0.0)


def worst_of(found):
    """Return the effect that, of all that were examined by themselves, leaves the largest gap."""
    single = [c for c in found.candidates if len(c.keys) == 1 and UNKNOWN not in c.keys]
    (key,) = max(single, key=lambda c: c.rest).keys
    return key


def test_after_a_cause_is_contradicted_by_its_simulation_the_next_one_is_named():
    """A wrong effect is made by far the likeliest; simulated, it does not bring the machine nearer."""
    true = ("coulomb_friction", "stick")
    plain = diagnosed((FIELD, (FAULTS[0],))).evidence.found
    best, wrong = max(c.log for c in plain.candidates), worst_of(plain)

    def favoured(candidate):
        if candidate.keys != {wrong}:
            return candidate
        return replace(candidate, hypothesis=replace(candidate.hypothesis, log=best + 500.0, rest=1.0))

    other = replace(plain, candidates=tuple(favoured(c) for c in plain.candidates))
    found = concluded(other, np.random.default_rng(1))
    assert names(found) == [true]
    assert any("{}@{}".format(*wrong) in said for said in found.refuted)
    assert wrong not in found.evidence.posterior
    assert sum(found.evidence.posterior.values()) == pytest.approx(1.0)


def test_where_every_cause_is_contradicted_the_gap_stays_unknown():
    plain = diagnosed((FIELD, (FAULTS[0],))).evidence.found
    best, wrong = max(c.log for c in plain.candidates), worst_of(plain)
    kept = [
        c if not c.keys else replace(c, hypothesis=replace(c.hypothesis, log=best, rest=1.0))
        for c in plain.candidates
        if not c.keys or c.keys == {wrong}
    ]
    found = concluded(replace(plain, candidates=tuple(kept), incidents=()), np.random.default_rng(1))
    assert (found.verdict, names(found)) == (Verdict.UNKNOWN, [])
    assert found.refuted


def test_where_every_cause_is_contradicted_a_healthy_machine_that_explains_the_residual_stays_no_gap():
    """A wrong cause is likelier, but the healthy machine leaves no gap, either: its uncertainty explains it."""
    plain, usual = diagnosed((FIELD, (FAULTS[0],))).evidence.found, diagnosed((FIELD, ())).evidence.found.healthy
    wrong = worst_of(plain)

    def like(c):
        log = plain.healthy.log + 20.0 * bool(c.keys)
        return replace(c, hypothesis=replace(c.hypothesis, log=log, rest=1.0, noise=usual.hypothesis.noise))

    kept = [like(c) for c in plain.candidates if c is plain.healthy or c.keys == {wrong}]
    wider = replace(plain, candidates=tuple(kept), incidents=(), gaps=np.full(len(plain.gaps), 1.5))
    found = concluded(wider, np.random.default_rng(1))
    assert (found.verdict, names(found)) == (Verdict.NO_GAP, [])
    assert found.refuted


def test_two_effects_are_both_named():
    friction, offset = effect("coulomb_friction", "stick", 4000.0), effect("angle_offset", "bucket_angle", 0.05)
    found = diagnosed((FIELD, (friction, offset)))
    assert set(names(found)) == {("coulomb_friction", "stick"), ("angle_offset", "bucket_angle")}
    assert found.simulated.share[0] > 0.9


def test_a_transient_contact_does_not_hide_a_lasting_fault():
    """For six seconds of sixty the teeth are in the ground."""
    contact = effect("soil_contact", "bucket", [2e3, 3e3], begin=40.0, end=46.0)
    found = diagnosed((FIELD, (FAULTS[0], contact)))
    assert names(found)[0] == ("coulomb_friction", "stick")
    assert found.evidence.found.work is None


def test_more_data_never_makes_it_worse():
    """The same fault in one recording and in two."""
    fault, true = FAULTS[0], ("coulomb_friction", "stick")
    one, both = diagnosed((FIELD, (fault,))), diagnosed((FIELD, (fault,)), (CHECK_UP, (fault,)))
    assert both.evidence.posterior[true] >= one.evidence.posterior[true] - 0.01
    assert names(both)[0] == true


def changed(seed, change):
    """Return the diagnosis of a healthy recording whose values were changed."""
    plain = recorded(seed)
    return diagnose(healthy_machine(), [replace(plain, values=change(plain.values))], np.random.default_rng(1))


def test_a_torque_that_no_effect_of_the_library_makes_is_unknown():
    """An angle sensor that errs in waves over its range."""

    def rippled(values):
        found, k = values.copy(), SIGNALS.index("stick_angle")
        found[:, k] += 0.02 * np.sin(15.0 * values[:, k])
        return found

    found = changed(FIELD, rippled)
    assert (found.verdict, names(found)) == (Verdict.UNKNOWN, [])
    assert found.evidence.posterior[UNKNOWN] > HALF
    assert found.shape["at"] == "stick"


@pytest.mark.parametrize(("late", "shows"), [(0.4, False), (5.0, True)])
def test_pressures_a_part_of_a_sample_late_are_healthy(late, shows):
    """Nodes take their readings when they like: from start to start they are up to a sample apart."""
    own = [k for k, name in enumerate(SIGNALS) if "pressure" in name]

    def shifted(values):
        found, k = values.copy(), np.arange(len(values))
        for signal in own:
            found[:, signal] = np.interp(k - late, k, values[:, signal])
        return found

    posterior = changed(FIELD, shifted).evidence.posterior
    clock = ("clock_fault", "machine")
    assert (max(posterior, key=lambda key: posterior[key]) == clock) is shows
    assert (posterior.get(clock, 0.0) > 0.1) is shows


def test_only_wanted_effects_are_named():
    """The true one is not among them."""
    found = diagnose(
        healthy_machine(),
        [recorded(FIELD, FAULTS[0])],
        np.random.default_rng(1),
        wanted=lambda p: p.name == "pressure_gain",
    )
    assert {key for key, _ in found.evidence.posterior} <= {"pressure_gain", *(key[0] for key in (NO_GAP, UNKNOWN))}
    assert names(found) == []
    assert found.verdict is Verdict.UNKNOWN


def test_a_healthy_machine_at_work_is_not_alarmed():
    found = diagnose(healthy_machine(), [dug(3)], np.random.default_rng(1))
    assert found.evidence.found.work is not None
    assert (found.verdict, names(found)) == (Verdict.NOT_OBSERVABLE, [])


def test_a_check_up_beside_a_working_recording_counts_in_full():
    """Beside an unknown load a mass on the tool cannot be seen; a check-up with an empty bucket shows it."""
    mass = effect("extra_mass", "bucket", [120.0, 90.0, 30.0, 90.0])
    check_up = replace(recorded(FIELD, mass), name="check-up")
    found = diagnose(healthy_machine(), [dug(3, mass), check_up], np.random.default_rng(1))
    assert found.evidence.found.work is not None
    assert found.evidence.found.work.names == {"dug 3"}
    assert names(found)[0][1] == "bucket"
    assert names(found)[0][0] in SAME
