"""What labelled cases teach of an answer, and which answer costs least."""

import numpy as np
import pytest

from cylforce.diagnosis.answer.calibration import Outcomes, calibrated
from cylforce.diagnosis.answer.verdict import Verdict, costs
from cylforce.diagnosis.inference.posterior import FEATURES, NOTHING, UNKNOWN, Belief
from layers.intervals import wilson
from layers.logistic import fitted


def test_a_calibration_says_how_often_each_outcome_is_true():
    rng = np.random.default_rng(0)
    outcome = rng.choice(4, 800, p=[0.1, 0.6, 0.1, 0.2])
    by = fitted(rng.standard_normal((800, 2)), outcome, np.ones(800), 0.5)
    said = {("one", "a"): 1.0 - 1e-4, ("two", "a"): 9e-5, ("three", "a"): 1e-5, NOTHING: 1e-9, UNKNOWN: 1e-12}
    belief = calibrated(Belief(said, (0.0, 0.0)), by)
    assert belief.of["one", "a"] == pytest.approx(0.6, abs=0.06)
    assert belief.of[NOTHING] == pytest.approx(0.1, abs=0.04)
    assert belief.of["two", "a"] / belief.of["three", "a"] == pytest.approx(3.0)
    assert sum(belief.of.values()) == pytest.approx(1.0)


def test_a_calibration_learns_from_what_tells():
    rng = np.random.default_rng(1)
    outcome = rng.choice(4, 400)
    features = np.eye(4)[outcome] + 0.1 * rng.standard_normal((400, 4))
    by = fitted(features, outcome, np.ones(400), 0.5)
    assert all(by(row)[k] > 0.9 for k, row in enumerate(np.eye(4)))


def test_without_any_effect_there_is_nothing_to_calibrate():
    by = fitted(np.zeros((4, 2)), np.arange(4), np.ones(4), 0.5)
    belief = Belief({NOTHING: 0.7, UNKNOWN: 0.3}, (0.0, 0.0))
    assert calibrated(belief, by) == belief


def test_intervals_are_wilsons():
    assert wilson(8, 10) == pytest.approx((0.490, 0.943), abs=1e-3)
    assert wilson(0, 0) == (0.0, 1.0)


def test_the_likeliest_effect_stays_the_likeliest_whatever_cases_teach():
    """Also where they teach that the first one is hardly ever the cause, and the others are."""
    of = {("one", "a"): 0.98, ("two", "b"): 0.01, ("two", "c"): 0.005, NOTHING: 0.005, UNKNOWN: 0.0}
    before = Belief(of, np.zeros(FEATURES))
    never = Outcomes(
        (0.0,) * FEATURES, (1.0,) * FEATURES, tuple((0.0,) * FEATURES + (w,) for w in (2.3, -5.8, 1.3, 2.3)), 0.001
    )
    found = calibrated(before, never).of
    effects = [found[key] for key in of if key not in (NOTHING, UNKNOWN)]
    assert effects[0] == max(effects)
    assert sum(found.values()) == pytest.approx(1.0)


@pytest.mark.parametrize(("first", "rival", "order", "cheapest"), [
    (0.69, 0.03, 0.23, Verdict.AMBIGUOUS),  # nothing else may be it, but it is not as sure as a name must be
    (0.82, 0.0, 0.1, Verdict.EXPLAINED),
    (0.3, 0.05, 0.6, Verdict.NO_GAP),
    (0.05, 0.05, 0.1, Verdict.UNKNOWN),
    (0.5, 0.4, 0.05, Verdict.AMBIGUOUS),
    (0.0, 0.0, 0.9, Verdict.NO_GAP),
])  # fmt: skip
def test_the_answer_costs_least_and_one_name_alone_is_sure(first, rival, order, cheapest):
    of = {("one", "a"): first, ("two", "a"): rival, NOTHING: order, UNKNOWN: 1.0 - first - rival - order}
    told = costs(Belief(of, ()), first, (rival,) if rival else ())
    assert min(told, key=told.__getitem__) is cheapest
    assert (Verdict.EXPLAINED in told) == (first >= 0.8)


def test_a_set_of_many_is_no_better_than_unknown():
    """Two candidates are worth to be looked at, ten that share the same are not."""
    two, ten = (costs(Belief({NOTHING: 0.1, UNKNOWN: 0.1}, ()), 0.8 / n, [0.8 / n] * (n - 1)) for n in (2, 10))
    assert min(two, key=two.__getitem__) is Verdict.AMBIGUOUS
    assert min(ten, key=ten.__getitem__) is Verdict.UNKNOWN
