"""Explanation of an answer: how far simulated causes close the gap, where it is, and what a refit removes."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.diagnosis import concluded, question_of
from cylforce.diagnosis.constants import SAME_MACHINE
from cylforce.diagnosis.explain import (
    Refit,
    Simulation,
    blocks_of,
    causes_of,
    closure,
    force_error,
    least_closure,
    objection_to_magnitude,
    objection_to_simulation,
    refitted,
    refitted_sheet,
    unexplained_shape,
    weight_error,
    where,
)
from cylforce.diagnosis.regressors import Regressors
from cylforce.diagnosis.search import examined
from cylforce.diagnosis.statistics import rms
from cylforce.effects.fault import BEYOND, INCIDENTAL, LAW_ERROR
from cylforce.effects.imposed import imposed
from cylforce.estimation.model import Model
from cylforce.readings.constants import HALF
from diagnosis.scenes import MACHINE, SERVICE, asked, diagnosed, effect, healthy_machine, names, recorded

FIELD = 5  # seed of a recording that nothing was learnt from
FAULT = effect("coulomb_friction", "stick", 2500.0)
OFFSET = effect("angle_offset", "stick_angle", 0.02)
CONTACT = effect("soil_contact", "bucket", [2e3, 3e3], begin=40.0, end=46.0)


def simulated(found, *causes):
    """Return the gap of a diagnosis before and after causes."""
    candidate = found.evidence.best_of(found.named[0].cause.key)
    return Simulation(found.evidence.found.question, candidate).run(causes, np.random.default_rng(1))


def cause_in(found, key):
    """Return a cause of the likeliest hypothesis that has it."""
    evidence = found.evidence
    return next(c for c in causes_of(evidence, evidence.best_of(key)) if c.key == key)


# Closure


def test_a_gap_at_one_joint_has_a_closure_though_the_other_joints_are_below_their_floor():
    floor = np.ones((40, 3))
    machine = SimpleNamespace(floor_seen=floor, floor_unseen=floor, floor=SimpleNamespace(rms=np.ones(3)))
    before, after = (np.tile([0.4, one, 0.4], (40, 1)) for one in (1.9, 1.0))
    value, (low, high) = closure(before, after, machine, np.random.default_rng(1))
    assert low <= value <= high == 1.0
    assert value == pytest.approx(1.0)
    assert np.isnan(closure(after, after, machine, np.random.default_rng(1))[0])


def test_a_right_cause_closes_the_gap_beside_parameters_that_are_fitted_to_the_same_recording():
    question = asked((FIELD, (effect("stribeck", "stick", 8000.0),)))
    free = question.with_free_parameters(refitted(question).values)
    found = concluded(examined(free, lambda p: p.name in ("stribeck", "coulomb_friction")), np.random.default_rng(1))
    assert names(found) == [("stribeck", "stick")]
    before, after = (rms(e) / healthy_machine().floor.rms for e in (found.simulated.before, found.simulated.after))
    assert np.all(after**2 - before**2 < SAME_MACHINE)
    assert found.simulated.closure > HALF


@pytest.mark.parametrize("fault", [FAULT, OFFSET], ids=["torque", "reading"])
def test_a_right_cause_closes_the_gap_on_spans_that_its_magnitude_was_not_fitted_to(fault):
    found = diagnosed((FIELD, (fault,)))
    assert names(found) == [(fault.group[0].about.name, fault.at)]
    closed, low, high = found.simulated.share
    assert low <= closed <= high <= 1.0
    assert closed > 0.97
    floor = healthy_machine().floor.rms
    assert np.max(rms(found.simulated.before) / floor) > 5.0
    assert np.all(rms(found.simulated.after) < 1.3 * floor)
    assert found.simulated.removed > 0.8 * np.sqrt(np.nanmean(np.concatenate(found.simulated.before) ** 2))


def test_the_opposite_of_a_cause_is_contradicted_by_its_simulation():
    found = diagnosed((FIELD, (FAULT,)))
    cause, question = found.named[0].cause, found.evidence.found.question
    wrong = replace(cause, sizes=-3.0 * cause.sizes)
    size = simulated(found, wrong)
    assert size.closure < 0.0
    assert "coulomb_friction@stick" in objection_to_simulation(question, (wrong,), size)
    assert objection_to_simulation(question, (cause,), simulated(found, cause)) == ""


def test_without_a_gap_there_is_no_share_of_it():
    found = diagnosed((FIELD, ()))
    assert np.isnan(found.simulated.closure)
    assert all(np.isnan(x) for x in found.simulated.share)
    question = found.evidence.found.question
    cause = diagnosed((FIELD, (FAULT,))).named[0].cause
    assert "no difference remains" in objection_to_simulation(question, (cause,), found.simulated)


def test_a_wide_interval_of_the_closure_says_nothing():
    found = diagnosed((FIELD, (FAULT,))).simulated
    assert not np.isnan(found.share[0])
    assert all(np.isnan(x) for x in replace(found, low=found.closure - 0.3).share)


def test_an_effect_that_lasts_is_contradicted_by_the_bound_of_its_closure_and_an_incident_by_the_closure_itself():
    """Sizes of an incident are those of the very blocks in which it is simulated."""
    found = diagnosed((FIELD, (FAULT,)))
    question, cause = found.evidence.found.question, found.named[0].cause
    least = least_closure(cause.proposal.about.torque_error)
    poor = replace(found.simulated, closure=least - 0.1, low=0.0, high=least + 0.1)
    assert objection_to_simulation(question, (cause,), poor) == ""
    assert objection_to_simulation(question, (replace(cause, form=None),), poor) != ""


def test_what_two_recordings_of_a_healthy_machine_differ_is_no_fault_of_a_law():
    """Of a gap of two floors a right cause may leave much, of a large one little."""
    found = diagnosed((FIELD, (FAULT,)))
    question, cause = found.evidence.found.question, found.named[0].cause
    floor, high = healthy_machine().floor.rms, least_closure(cause.proposal.about.torque_error) - 0.2

    def objection(gap):
        before = [gap * np.broadcast_to(floor, seen.rows.residual.shape) for seen in question.seen]
        found_then = replace(found.simulated, before=before, after=[0.5 * e for e in before], closure=high, high=high)
        return objection_to_simulation(question, (cause,), found_then)

    assert objection(2.0) == ""
    assert "much of the difference" in objection(10.0)


def test_a_cause_that_removes_nothing_is_contradicted_however_small_the_gap():
    """What two recordings of a healthy machine differ allows a cause to leave a small gap, but not all of it."""
    found = diagnosed((FIELD, (FAULT,)))
    question, cause = found.evidence.found.question, found.named[0].cause
    before = [1.3 * np.broadcast_to(healthy_machine().floor.rms, s.rows.residual.shape) for s in question.seen]
    for closed, objected in ((-0.3, True), (0.0, True), (0.1, False)):
        same = replace(found.simulated, before=before, after=before, closure=closed, high=1.0)
        assert bool(objection_to_simulation(question, (cause,), same)) == objected


def test_a_cause_that_makes_a_joint_worse_is_contradicted():
    found = diagnosed((FIELD, (FAULT,)))
    question, cause = found.evidence.found.question, found.named[0].cause
    floor = healthy_machine().floor.rms
    flat = [np.broadcast_to(floor, seen.rows.residual.shape) for seen in question.seen]
    closed = replace(found.simulated, before=flat, closure=1.0, high=1.0)
    within, beyond = ([e * [1.0, x] for e in flat] for x in (np.sqrt(1.0 + SAME_MACHINE) - 0.01, 2.4))
    assert objection_to_simulation(question, (cause,), replace(closed, after=within)) == ""
    said = objection_to_simulation(question, (cause,), replace(closed, after=beyond))
    assert "the bucket differs more from the recordings than before" in said


@pytest.mark.parametrize(("joint", "contradicted"), [(0, True), (1, False)])
def test_a_joint_may_become_worse_by_as_much_as_its_own_references_differ(joint, contradicted):
    """References that differ at the stick say nothing of the bucket."""
    found = diagnosed((FIELD, (FAULT,)))
    question, cause = found.evidence.found.question, found.named[0].cause
    machine = question.machine
    unseen = np.broadcast_to(machine.floor.rms**2, machine.floor_unseen.shape).copy()
    unseen[:, joint] *= 9.0
    question = replace(question, machine=replace(machine, floor_unseen=unseen))
    flat = [np.broadcast_to(machine.floor.rms, seen.rows.residual.shape) for seen in question.seen]
    worse = replace(found.simulated, before=flat, after=[e * [1.0, 2.4] for e in flat], closure=1.0, high=1.0)
    assert ("the bucket differs more" in objection_to_simulation(question, (cause,), worse)) == contradicted


def test_a_cause_that_makes_weights_worse_is_contradicted():
    """Before: as much torque that weighs nothing, for it changes its sign half-way."""
    found = diagnosed((FIELD, (FAULT,)))
    question, cause = found.evidence.found.question, found.named[0].cause
    mass, floor = INCIDENTAL.index("load.mass"), healthy_machine().floor.rms
    unit = [seen.rows.incidental[..., mass] for seen in question.seen]
    kg = 3.0 / np.sqrt(np.mean((rms(unit) / floor) ** 2))
    after = [kg * e for e in unit]
    before = [e * np.where(np.arange(len(e)) < len(e) / 2, 1.0, -1.0)[:, None] for e in after]
    closed = replace(found.simulated, closure=1.0, high=1.0)
    assert weight_error(question, after) == pytest.approx(kg, rel=0.3)
    assert "weights are more wrong" in objection_to_simulation(
        question, (cause,), replace(closed, before=before, after=after)
    )
    assert objection_to_simulation(question, (cause,), replace(closed, before=after, after=before)) == ""


def test_the_gap_before_any_cause_knows_none():
    """The residual before is that of the question, whatever is simulated afterwards."""
    found = diagnosed((FIELD, (FAULT,)))
    expected = asked((FIELD, (FAULT,))).residuals()
    for one, other in zip(found.simulated.before, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


def test_a_steady_force_at_the_teeth_is_what_its_torque_looks_like():
    question = asked((FIELD, ()))
    columns = [INCIDENTAL.index(name) for name in ("tip.x.0", "tip.z.0")]
    made = [seen.rows.incidental[..., columns] @ np.array([3e3, 4e3]) for seen in question.seen]
    assert force_error(question, made) == pytest.approx(5e3, rel=0.1)


# Magnitudes


def test_a_magnitude_at_its_bound_or_an_interval_that_contains_zero_is_not_named():
    found = diagnosed((FIELD, (FAULT,)))
    cause, forms = found.named[0].cause, found.evidence.found.question.forms
    assert objection_to_magnitude(cause) == ""
    largest = np.array([[BEYOND * forms[cause.form].high]])
    assert "largest plausible" in objection_to_magnitude(replace(cause, sizes=largest))
    assert "contains zero" in objection_to_magnitude(replace(cause, errors=np.abs(cause.sizes)))


def test_a_magnitude_beyond_the_largest_plausible_one_is_simulated_as_that():
    found = diagnosed((FIELD, (FAULT,)))
    cause, forms = found.named[0].cause, found.evidence.found.question.forms
    largest = BEYOND * forms[cause.form].high
    most, more = (simulated(found, replace(cause, sizes=np.full_like(cause.sizes, f * largest))) for f in (1.0, 3.0))
    np.testing.assert_allclose(rms(more.after), rms(most.after), rtol=0.02)
    assert rms(most.after)[0] > 1.5 * rms(most.before)[0]


def test_an_interval_holds_nine_tenths_of_a_normal_distribution():
    cause = diagnosed((FIELD, (FAULT,))).named[0].cause
    value, low, high = cause.interval
    assert (high - low) / 2.0 == pytest.approx(1.6449 * cause.errors[0, 0])
    assert value == pytest.approx((low + high) / 2.0) == cause.sizes[0, 0]


# Patch


@pytest.mark.parametrize("fault", [FAULT, OFFSET], ids=["torque", "reading"])
def test_the_patch_makes_the_simulated_machine_like_the_recorded_one(fault):
    """Its blocks are read by the simulator, and leave little of the gap."""
    found = diagnosed((FIELD, (fault,)))
    blocks = blocks_of(found.evidence.found.question, [named.cause for named in found.named])
    assert [(b["name"], b["at"]) for b in blocks] == names(found)
    effects = [imposed(MACHINE, b["name"], b["at"], b["value"], shape=b.get("shape")) for b in blocks]
    healthy, faulty, patched = (asked((FIELD, own)).residuals()[0] for own in ((), (fault,), tuple(effects)))
    assert rms([patched - faulty])[0] < 0.15 * rms([healthy - faulty])[0]


def test_the_patch_of_a_contact_has_its_time():
    found = diagnosed((FIELD, (CONTACT,)))
    assert names(found) == [("soil_contact", "bucket")]
    blocks = blocks_of(found.evidence.found.question, [named.cause for named in found.named])
    begins, ends = np.array([b["from_s"] for b in blocks]), np.array([b["until_s"] for b in blocks])
    assert np.all(ends > begins)
    assert np.min(begins) > CONTACT.begin - 4.0
    assert np.max(ends) < CONTACT.end + 5.0
    assert found.simulated.closure > least_closure(LAW_ERROR)


def test_the_less_certain_a_law_the_more_it_may_leave():
    """Right and wrong are equally likely where the density of what a right law leaves is one."""
    errors = np.array([0.05, 0.1, 0.2, 0.35])
    left = 1.0 - np.array([least_closure(error) for error in errors])
    assert np.all(np.diff(left) > 0.0)
    np.testing.assert_allclose(np.exp(-left / (2.0 * errors**2)) / (2.0 * errors**2), 1.0)


# Where


def test_places_are_sorted_by_the_joint_with_the_largest_gap_over_its_floor():
    found = diagnosed((FIELD, (FAULT,)))
    assert found.spots[0].joint == "stick"
    assert found.spots[0].found
    joints = [spot.joint for spot in found.spots]
    assert joints == sorted(joints, key=lambda name: name != "stick")
    for joint in set(joints):
        floors = [spot.floors for spot in found.spots if spot.joint == joint]
        assert floors == sorted(floors, reverse=True)
    assert not any(spot.found for spot in found.spots if spot.joint == "bucket")


def test_a_gap_in_one_regime_is_found_there():
    """Torque is added to a healthy recording while the stick's cylinder extends."""
    question = asked((FIELD, ()), (6, ()))
    made = [e.copy() for e in question.residuals()]
    for seen, e in zip(question.seen, made, strict=True):
        own = MACHINE.spans.index((MACHINE.rows[0],))
        e[:, 0] += (
            5.0 * healthy_machine().floor.rms[0] * (seen.rows.speed[:, own] > 0.0) * np.sign(np.sin(9.0 * seen.rows.t))
        )
    spots = {(s.joint, s.regime): s for s in where(question, made)}
    assert spots["stick", "extending"].found
    assert spots["stick", "extending"].share == pytest.approx(1.0, abs=0.1)
    assert not spots["stick", "retracting"].found
    assert not any(s.found for s in spots.values() if s.joint == "bucket")


def test_the_picture_shows_the_worst_place_in_bar():
    found = diagnosed((FIELD, (FAULT,)))
    picture, question = found.picture, found.evidence.found.question
    assert picture.cylinder == "stick"
    assert len(picture.t) == len(picture.measured) == len(picture.before) == len(picture.after) > 0
    gap, rest = (np.sqrt(np.nanmean((picture.measured - e) ** 2)) for e in (picture.before, picture.after))
    assert rest < 0.3 * gap
    seen, first = question.seen[0], int(np.flatnonzero(question.seen[0].rows.t == picture.t[0])[0])
    own = slice(first, first + len(picture.t))
    lever = MACHINE.geometry(seen.rows.posture[own]).lever[:, 0, MACHINE.rows[0]]
    torque = (picture.measured - picture.before) * 1e5 * MACHINE.cylinders[0].area_head * lever
    np.testing.assert_allclose(torque, found.simulated.before[0][own, 0], rtol=1e-6, atol=1e-6)


# Shape of an unexplained residual


RATE_HZ, NOISE, SEED = 20.0, 50.0, 3


@cache
def swinging(seconds=300.0):
    """Return a question with a joint that goes to and fro at changing speed, and white noise (T, 2).

    Its cylinder's load rises with its angle and with what swings beside it. A second joint is still.
    """
    rng, t = np.random.default_rng(SEED), np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    phase = np.cumsum(1.0 + 0.6 * np.sin(0.11 * t + rng.uniform(0.0, 6.0))) / RATE_HZ
    position = -1.5 + 0.8 * np.sin(0.5 * phase) + 0.1 * np.sin(0.031 * t)
    speed, other = np.gradient(position, t) * 0.4, np.sin(0.23 * t + rng.uniform(0.0, 6.0))
    force = np.stack([1e5 * other, 5e4 * (position + 1.5) + 6e4 * other], axis=1)
    still = np.zeros_like(t)
    rows = SimpleNamespace(
        t=t, posture=np.stack([still, position], axis=1), speed=np.stack([still, speed], axis=1), force=force
    )
    named = [SimpleNamespace(name="boom"), SimpleNamespace(name="stick")]
    machine = SimpleNamespace(rows=(0, 1), links=named, cylinders=named)
    model = SimpleNamespace(machine=machine, acting=((0,), (1,)))
    healthy = SimpleNamespace(regressors=SimpleNamespace(model=model), floor=SimpleNamespace(rms=np.full(2, NOISE)))
    question = SimpleNamespace(machine=healthy, seen=(SimpleNamespace(rows=rows),))
    return question, rng.normal(0.0, NOISE, (len(t), 2))


def shape_of(torque):
    """Return the shape of the stick's residual with a torque in excess."""
    question, noise = swinging()
    rows, residual = question.seen[0].rows, noise.copy()
    residual[:, 1] += torque(rows.posture[:, 1], rows.speed[:, 1], rows.force, rows.t)
    residual[::50] = np.nan
    return unexplained_shape(question, [residual])


MADE = {
    "position": lambda q, v, f, t: 600.0 * np.exp(-(((q + 1.2) / 0.3) ** 2)) * np.tanh(v / 0.01),
    "speed": lambda q, v, f, t: 4000.0 * v,
    "load": lambda q, v, f, t: 4e-3 * np.abs(f[:, 0]),
    "time": lambda q, v, f, t: 300.0 * np.sin(2.0 * np.pi * t / 400.0) ** 2 * np.tanh(v / 0.01),
    "moments": lambda q, v, f, t: 3000.0 * np.sin(t) * (np.mod(t * 0.01 * np.sqrt(2.0), 0.3) < 0.01),
}


@pytest.mark.parametrize("of", MADE)
def test_a_residual_made_as_a_function_of_one_quantity_is_reported_as_that(of):
    found = shape_of(MADE[of])
    assert (found["at"], found["of"]) == ("stick", of), found
    assert found["share"] > HALF
    assert found["detail"] == ("force of the boom cylinder" if of == "load" else "")
    assert all(0.0 < other["share"] <= 1.0 for other in found["alternatives"])


def test_white_noise_is_a_function_of_nothing():
    noise = np.random.default_rng(SEED).normal(0.0, 5.0 * NOISE, len(swinging()[1]))
    found = shape_of(lambda *_: noise)
    assert (found["of"], found["share"]) == ("none", 0.0)
    assert max((other["share"] for other in found["alternatives"]), default=0.0) < 0.1


# Refit


def test_a_refit_finds_a_stick_eight_per_cent_too_heavy():
    """The model's stick is, and the machine's is not."""
    machine = healthy_machine()
    model, values = (
        machine.regressors.model,
        machine.regressors.parameters + machine.values[: len(machine.regressors.parameters)],
    )
    own = [k for k, p in enumerate(model.parameters[: 3 * MACHINE.size]) if p.name.startswith("stick")]
    assert len(own) == 3
    heavy = values.copy()
    heavy[own] *= 1.08
    wrong = replace(machine, regressors=Regressors(model, heavy), values=np.zeros_like(machine.values))
    found = refitted(question_of(wrong, [recorded(FIELD)], np.random.default_rng(1)))
    assert found.share > 0.9
    assert np.all(found.after <= found.before)
    first = found.changes[0]
    assert first.name.startswith("stick")
    assert first.before / first.after == pytest.approx(1.08, abs=0.03)


def test_a_refit_of_a_healthy_machine_changes_hardly_anything():
    found = refitted(asked((FIELD, ())))
    assert isinstance(found, Refit)
    assert np.all(found.before < 1.3 * healthy_machine().floor.rms)
    assert np.all(found.after > 0.9 * found.before)


def test_a_refit_of_the_data_sheet_removes_its_masses_and_friction():
    """The true masses differ from the machine file by ten per cent, and it has no friction."""
    model = Model(MACHINE, SERVICE.filters, ())
    sheet = Regressors(model, model.prior.mean)
    machine = replace(healthy_machine(), regressors=sheet, values=np.zeros_like(healthy_machine().values))
    question = replace(asked((FIELD, ())), machine=machine)
    rows = sheet.rows(recorded(FIELD), ())
    seen = replace(question.seen[0], rows=replace(question.seen[0].rows, residual=rows.residual))
    assert rms([seen.rows.residual]).max() > 10.0 * healthy_machine().floor.rms.max()
    found = refitted_sheet(replace(question, as_read=(seen,)), asked((FIELD, ())))
    assert found.share > 0.9
    assert any("coulomb" in change.name for change in found.changes[:6])
