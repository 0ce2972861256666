"""Hypotheses that are withdrawn from what was found: two causes that are one answer, and one that its simulation
refutes."""

from dataclasses import replace

import numpy as np
import pytest

from cylforce.diagnosis.inference.discrepancy import Scatter
from cylforce.diagnosis.inference.found import Found, one_answer, without
from cylforce.diagnosis.inference.hypotheses import Hypothesis
from cylforce.diagnosis.inference.posterior import UNKNOWN, Asked, Happened, believed
from cylforce.diagnosis.inference.sizes import Column
from cylforce.diagnosis.numbers import ALIKE, HALF

MASS, MOMENT, OTHER = ("extra_mass", "boom"), ("first_moment_change", "boom"), ("pressure_gain", "boom_head_pressure")
SLEW, CONTACT = ("slew_centrifugal", "machine"), ("soil_contact", "bucket")
FORMS = tuple(Column(*key, (k,), 1.0, 10.0, 0, 1) for k, key in enumerate((MASS, MOMENT, OTHER)))
NOISE = Scatter(np.ones(1), np.ones(1))
GAP = 5.0  # floors


def hypothesis(log, *which):
    size = np.ones(len(which))
    return Hypothesis(which, log, NOISE, size, 0.1 * size, 1.0 if which else GAP)


def found(*hypotheses, happened=()):
    asked = Asked(FORMS, (hypothesis(0.0), *hypotheses), happened, NOISE, GAP, references=2)
    return Found(None, None, None, asked, {}, {}, False, {}, (None, None))


@pytest.mark.parametrize(("ahead", "one"), [(ALIKE - 0.1, True), (-ALIKE + 0.1, True), (ALIKE + 0.1, False)])
def test_a_mass_and_a_first_moment_of_a_link_that_no_evidence_separates_are_one_answer(ahead, one):
    told = found(hypothesis(100.0 + ahead, 0), hypothesis(100.0, 1), hypothesis(90.0, 2))
    before, after = (believed(each.asked).of for each in (told, one_answer(told)))
    first, other = (MASS, MOMENT) if ahead > 0.0 else (MOMENT, MASS)
    assert one_answer(told).same == ({first: other} if one else {})
    assert (other in after) is not one
    assert sum(after.values()) == pytest.approx(1.0)
    if one:
        assert after[first] == pytest.approx(before[first] + before[other], abs=1e-3)


def test_of_two_causes_that_are_one_answer_the_one_in_the_most_probable_hypothesis_stays():
    told = one_answer(found(hypothesis(100.0, 0), hypothesis(99.0, 1), hypothesis(150.0, 1, 2)))
    assert told.same == {MOMENT: MASS}
    assert {h.which for h in told.asked.hypotheses} == {(), (1,), (1, 2)}


def test_a_mass_beside_a_first_moment_in_the_most_probable_hypothesis_is_no_single_answer():
    told = found(hypothesis(100.0, 0), hypothesis(99.0, 1), hypothesis(150.0, 0, 1))
    assert one_answer(told) is told


def test_a_mass_and_a_first_moment_of_different_links_are_two_answers():
    told = found(hypothesis(100.0, 0), hypothesis(99.0, 1))
    forms = (FORMS[0], FORMS[1]._replace(at="stick"), FORMS[2])
    apart = replace(told, asked=replace(told.asked, forms=forms))
    assert one_answer(apart) is apart


def test_without_a_cause_the_others_have_all_probability():
    contact = Happened(CONTACT, 95.0, 0.1, 1.0)
    told = found(hypothesis(100.0, 0), hypothesis(98.0, 2), hypothesis(120.0, 0, 2), happened=(contact,))
    left = without(told, MASS)
    assert {h.which for h in left.asked.hypotheses} == {(), (2,)}
    before, after = (believed(each.asked).of for each in (told, left))
    assert MASS not in after
    assert sum(after.values()) == pytest.approx(1.0)
    assert after[OTHER] > HALF > before[OTHER]
    assert without(left, contact.key).asked.happened == ()


@pytest.mark.parametrize(
    ("key", "busy", "first"),
    [
        (SLEW, 0.2, SLEW),
        (SLEW, 0.9, SLEW),
        (CONTACT, 0.2, CONTACT),
        (CONTACT, 0.9, UNKNOWN),
    ],
)
def test_slewing_is_named_however_long_it_lasts(key, busy, first):
    """Contact most of the time is the machine's work; a house may slew all day."""
    told = believed(found(happened=(Happened(key, 200.0, busy, 1.0),)).asked)
    assert (told.first, told.probability) == (first, pytest.approx(1.0))
