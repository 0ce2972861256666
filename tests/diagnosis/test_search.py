"""The search finds what was put in, and nothing else; effects are taken out of the readings at their magnitudes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.diagnosis import question_of
from cylforce.diagnosis.constants import SAME_MACHINE
from cylforce.diagnosis.decide import HypothesisEvidence
from cylforce.diagnosis.likelihood import TemperatureChange, likeliest_noise
from cylforce.diagnosis.search import (
    CONTACT,
    NO_GAP,
    UNKNOWN,
    Applied,
    Candidate,
    Found,
    changed_load,
    examined,
    incidents,
    screened,
    searched,
    without_gap,
)
from cylforce.diagnosis.statistics import Gram, rms
from cylforce.readings.constants import BLOCK_ROWS, ROWS_HZ
from diagnosis import synthetic
from diagnosis.scenes import PROPOSALS, asked, diagnosed, dug, effect, healthy_machine, learnt_from, recorded

FIELD = 5  # seed of a recording that nothing was learnt from
FRICTION = effect("coulomb_friction", "stick", 2500.0)
OFFSET = effect("angle_offset", "stick_angle", 0.02)


def likeliest(rows):
    """Return the likeliest answer for synthetic rows."""
    case = synthetic.likelihood(rows)
    machine = SimpleNamespace(spread=SAME_MACHINE)
    question = SimpleNamespace(incident_forms={}, forms=synthetic.FORMS, laid=None, machine=machine)
    found = [Candidate(h, question) for h in searched(case, range(2))]
    gap = case.rests(np.append(-case.machine.mean, 1.0))
    return HypothesisEvidence(Found(question, case, tuple(found), (), gap)).first


@pytest.mark.parametrize(
    ("sizes", "level", "answer"),
    [
        ((0.0, 0.0), 1.0, NO_GAP),
        ((1.5, 0.0), 1.0, ("one", "a")),
        ((0.0, -1.5), 1.0, ("two", "b")),
        ((0.0, 0.0), 60.0, UNKNOWN),
    ],
)
def test_what_was_put_in_is_found_and_nothing_else(sizes, level, answer):
    assert likeliest(synthetic.rows(6, sizes, level)) == answer


def test_two_effects_are_found_together():
    case = synthetic.likelihood(synthetic.rows(6, (1.5, 1.0)))
    best = max(searched(case, range(2)), key=lambda h: h.log)
    assert best.forms == (0, 1)
    assert best.sizes * synthetic.UNIT[2:] == pytest.approx([1.5, 1.0], abs=0.1)


def test_effects_are_searched_with_and_without_another_temperature_where_that_explains_much():
    """Another temperature explains half of the effect, so that the beam would hold hypotheses beside it alone."""
    case = synthetic.likelihood(synthetic.rows(6, (2.0, 0.0)))
    nothing, alike = np.zeros((synthetic.COLUMNS,) * 2), np.zeros((synthetic.COLUMNS,) * 2)
    alike[2, 2] = 1.0  # the column of the effect, as if it were a law of friction
    case = replace(case, machine=replace(case.machine, temperature=TemperatureChange(nothing, alike)))
    found = searched(case, range(2))
    warmer, usual = (
        {h.forms: h.log for h in found if (h.noise.conditions.temperature is not None) == other}
        for other in (True, False)
    )
    assert warmer[()] > usual[()]
    assert usual[(0,)] > warmer[()]
    assert (0, 1) in usual
    assert (0, 1) in warmer


def test_forms_are_screened_all_at_once_as_one_by_one():
    case = synthetic.likelihood(synthetic.rows(6, (1.5, 0.8)))
    none = case.hypothesis((), synthetic.USUAL)
    state, each = case.state(none.noise), {}
    for p in (0, 1):
        _, fitted, residual = case.under((p,), state)
        _, log = likeliest_noise(case.gram, *case.gram.certain_energies(residual[None]), case.machine.noise)
        moved = residual[:-1] + case.machine.mean
        moved[case.columns((p,))] += fitted.more
        each[p] = log[0] - 0.5 * moved @ case.machine.prior_precision(none.noise.conditions)[0] @ moved
    assert screened(case, none, (1, 0)) == sorted(each, key=lambda p: -each[p])
    assert screened(case, case.hypothesis((0,), synthetic.USUAL), (1, 0)) == [1]


def test_a_residual_like_that_of_two_recordings_of_a_healthy_machine_is_no_gap():
    assert without_gap(np.array([0.5, 1.0, 1.29, 1.31, 5.0])).tolist() == [True, True, True, False, False]
    assert without_gap(np.array([10.0, 14.0]), np.array([10.0, 10.0])).tolist() == [True, False]


def test_an_effect_that_acts_at_a_joint_without_a_gap_alone_is_no_candidate():
    """However much evidence for it adds up over the recordings. What acts at several joints is one."""
    found = diagnosed((FIELD, (FRICTION,))).evidence.found
    assert without_gap(found.gaps).tolist() == [False, True]
    keys = {key for c in found.candidates for key in c.keys}
    assert ("coulomb_friction", "stick") in keys
    assert keys.isdisjoint({("coulomb_friction", "bucket"), ("end_cushion", "bucket"), ("linkage_geometry", "bucket")})


# Effects taken out of the readings


def form_of(question, key):
    return next(k for k, f in enumerate(question.forms) if f.key == key)


def applied(question, own, factor=1.0):
    form = form_of(question, (own.group[0].about.name, own.at))
    return form, Applied(question.proposals[form], factor * np.array(own.sizes))


def test_a_recording_corrected_for_its_fault_is_that_of_a_healthy_machine():
    question = asked((FIELD, (OFFSET,)))
    other = question.corrected([applied(question, OFFSET)])
    floor = question.machine.floor.rms
    assert np.max(rms(question.residuals()) / floor) > 5.0
    assert np.max(rms(other.residuals()) / floor) < 1.3
    assert np.max(rms(question.corrected([applied(question, OFFSET, -1.0)]).residuals()) / floor) > 10.0


def test_columns_of_other_effects_stay_as_they_are():
    question = asked((FIELD, (OFFSET,)))
    form, one = applied(question, OFFSET)
    other, layout = question.corrected([(form, one)]), question.machine.layout
    own = layout.places[layout.proposals.index(one.proposal)]
    before, after = (q.seen[0].rows.effects for q in (question, other))
    changed = np.any(np.abs(after - before) > 1e-6 * np.max(np.abs(before), axis=(0, 1)), axis=(0, 1))
    assert set(np.flatnonzero(changed)) <= {k - layout.first for k in own}


def test_noise_that_a_correction_takes_out_of_the_readings_is_what_its_column_shares():
    """y' = y - X s, so that the energy of the noise in y changes by -2 s cov(X, y)."""
    question, size = asked((FIELD, ())), 1e-3
    layout, shared = question.machine.layout, question.seen[0].shared(range(question.machine.layout.size))
    for at in ("stick_head_pressure", "bucket_rod_pressure"):
        form = form_of(question, ("pressure_gain", at))
        more, less = (
            question.corrected([(form, Applied(question.proposals[form], np.array([sign * size])))]).noise
            for sign in (1.0, -1.0)
        )
        (column,) = layout.places[layout.proposals.index(question.proposals[form])]
        expected = 2.0 * np.sum(shared.products[:, :, 0, column], axis=0) / np.sum(shared.counts, axis=0)
        slope = (more - less)[:, 0] / (2.0 * size)
        assert np.max(np.abs(expected)) > 0.0
        assert np.max(np.abs(slope - expected)) < 0.1 * np.max(np.abs(expected)), at


def test_without_a_correction_no_noise_is_given_back():
    question = asked((FIELD, ()))
    np.testing.assert_allclose(question.corrected([]).noise, 0.0, atol=1e-3)


def test_the_gram_of_a_corrected_recording_is_that_of_all_its_rows():
    """Only the columns that the correction changes are multiplied again."""
    question = asked((FIELD, (OFFSET,)))
    other = question.corrected([applied(question, OFFSET)])
    found, parts = other.gram(), [other.gram(third) for third in thirds(other)]
    assert np.max(np.abs(found.whole - question.gram().whole)) > 1.0
    for name in ("whole", "smooth", "shared"):
        one, two = getattr(found, name), np.sum([getattr(part, name) for part in parts], axis=0)
        assert np.max(np.abs(one - two)) <= 1e-9 * np.max(np.abs(two)), name


def test_a_candidate_has_no_rows_of_its_correction_and_gets_the_same_ones_again():
    question = asked((FIELD, (OFFSET,)))
    other = question.corrected([applied(question, OFFSET)])
    before = other.likelihood().healthy.log
    bare = other.without_rows()
    assert {"seen", "blocks", "_corrected", "_whole_gram"}.isdisjoint(vars(bare))
    assert bare.likelihood().healthy.log == before
    assert bare.uncorrected().likelihood().healthy.log == question.likelihood().healthy.log
    assert question.without_rows() is question


def test_the_gram_of_two_recordings_is_the_sum_of_both():
    one, two, both = asked((FIELD, ())), asked((6, ())), asked((FIELD, ()), (6, ()))
    total, whole = Gram.total([one.gram(), two.gram()]), both.gram()
    for name in ("whole", "smooth", "rows", "blocks"):
        np.testing.assert_allclose(getattr(whole, name), getattr(total, name), rtol=1e-9, atol=1e-9)


def test_some_blocks_of_a_question_are_those_of_its_gram():
    question = asked((FIELD, ()))
    one, two, three = thirds(question)
    parts = Gram.total([question.gram(third) for third in (one, two, three)])
    np.testing.assert_allclose(parts.whole, question.gram().whole, rtol=1e-9)
    np.testing.assert_allclose(parts.rows, question.gram().rows)
    others, both = Gram.total([question.gram(one), question.gram(two)]), question.gram(one | two)
    np.testing.assert_allclose(both.rows, others.rows)
    for name in ("whole", "smooth"):
        assert np.max(np.abs(getattr(both, name) - getattr(others, name))) <= 1e-9 * np.max(getattr(others, name))


def thirds(question):
    """Every third block of a question, in three ways: each is computed by itself."""
    return [np.arange(len(question.times)) % 3 == k for k in range(3)]


# Known loads


SPILL_S = 36.0
WITH_LOADS = tuple(p for p in PROPOSALS if p.name in ("payload_spill", "payload_shift", "coulomb_friction"))


def test_a_known_load_that_falls_out_is_found_at_its_time_with_its_mass():
    spill = effect("payload_spill", "bucket", [-250.0, -200.0, -30.0], begin=SPILL_S)
    machine = learnt_from(recorded(1), recorded(2, load_kg=600.0), wanted=WITH_LOADS)
    question = question_of(machine, [recorded(FIELD, spill, load_kg=600.0)], np.random.default_rng(1))
    step = changed_load(question, question.likelihood())
    assert abs(question.times[step.first] - SPILL_S) < 2.0 * BLOCK_ROWS / ROWS_HZ
    (residual,), (without_step,) = replace(question, step=step).residuals(), question.residuals()
    block_of_change = slice(BLOCK_ROWS * step.first, BLOCK_ROWS * (step.first + 1))
    assert np.all(np.isnan(residual[block_of_change]))  # it was not fitted
    others = [np.isnan(np.delete(rows, block_of_change, axis=0)) for rows in (residual, without_step)]
    np.testing.assert_array_equal(*others)
    found = HypothesisEvidence(examined(question, lambda _: True))
    assert ("payload_spill", "bucket") in found.credible, found.posterior
    best = found.best_of(("payload_spill", "bucket"))
    (form,) = best.hypothesis.forms
    mass = best.hypothesis.sizes[0] * found.found.question.unit[found.found.question.forms[form].columns[0]]
    error = best.hypothesis.errors[0] * found.found.question.unit[found.found.question.forms[form].columns[0]]
    assert abs(mass + 250.0) < max(4.0 * error, 25.0)


def test_without_a_known_load_none_can_change():
    question = asked((FIELD, ()))
    assert changed_load(question, question.likelihood()) is None
    assert not question.forms[form_of(question, ("payload_spill", "bucket"))].columns


def test_a_known_load_that_stays_does_not_change():
    """A block was left out of every hypothesis, whatever the evidence."""
    question = question_of(healthy_machine(), [recorded(FIELD, load_kg=600.0)], np.random.default_rng(1))
    assert changed_load(question, question.likelihood()) is None


def test_a_known_load_leaves_a_healthy_machine_without_a_gap():
    """Where it hangs is fitted."""
    question = question_of(healthy_machine(), [recorded(FIELD, load_kg=600.0)], np.random.default_rng(1))
    assert np.all(rms(question.residuals()) < 1.5 * healthy_machine().floor.rms)


# Incidents


def test_contact_is_found_in_the_blocks_in_which_it_happens():
    begin, end = 40.0, 46.0
    question = asked((FIELD, (effect("soil_contact", "bucket", [2e3, 3e3], begin=begin, end=end),)))
    (found,) = incidents(question, question.likelihood(), question.plain, lambda p: p.name == CONTACT)
    half, middle = BLOCK_ROWS / ROWS_HZ / 2.0, question.times
    inside = (middle > begin + half) & (middle < end - half)
    outside = (middle < begin - half) | (middle > end + 2.0 * half)
    assert np.all(found.sizes[inside] > 0.0)
    assert np.mean(found.sizes[outside] > 0.0) < 0.15
    assert 0.05 < found.share < 0.3
    assert found.log > question.likelihood().healthy.log + 20.0


def test_an_incident_is_present_in_some_block():
    """One without blocks is the hypothesis without it, and would count twice."""
    for own in ((), (FRICTION,)):
        question = asked((FIELD, own))
        found = incidents(question, question.likelihood(), question.plain, lambda _: True)
        assert all(np.any(incident.sizes > 0.0) for incident in found)


# Work


def test_loads_of_a_digging_machine_are_no_noise():
    """Beside its payloads a healthy machine has no gap, though the loads alone make a hundred times the floor."""
    question = question_of(healthy_machine(), [dug(3)], np.random.default_rng(1))
    found = examined(question, lambda p: p.name in (CONTACT, "coulomb_friction"))
    assert np.max(rms(question.residuals()) / healthy_machine().floor.rms) > 50.0
    assert found.work is not None
    assert np.max(found.gaps) < 3.0
    assert HypothesisEvidence(found).first == NO_GAP


def test_a_machine_in_the_air_is_not_at_work():
    for own in ((), (FRICTION,)):
        assert diagnosed((FIELD, own)).evidence.found.work is None


def test_a_lasting_fault_of_a_digging_machine_is_found_beside_its_loads():
    friction = effect("coulomb_friction", "stick", 6000.0)
    question = question_of(healthy_machine(), [dug(3, friction)], np.random.default_rng(1))
    found = examined(question, lambda _: True)
    assert found.work is not None
    assert ("coulomb_friction", "stick") in HypothesisEvidence(found).credible


# Columns at their magnitudes


@pytest.mark.parametrize("own", [(OFFSET,), (OFFSET, FRICTION)])
def test_the_likeliest_hypothesis_is_examined_at_its_magnitudes(own):
    found = diagnosed((FIELD, own)).evidence.found
    likeliest = max(found.candidates, key=lambda c: c.log)
    assert ("angle_offset", "stick_angle") in likeliest.keys
    assert not likeliest.is_linear
    same = [
        (c.hypothesis.forms, c.hypothesis.noise.conditions.temperature, id(c.incident), c.beside_contact)
        for c in found.candidates
    ]
    assert len(set(same)) == len(same)  # a hypothesis counts once, whatever it was corrected for
    corrections = [c.question for c in found.candidates if c.question.applied]
    assert corrections
    assert all("seen" not in vars(question) for question in corrections)  # rows take tens of megabytes each
