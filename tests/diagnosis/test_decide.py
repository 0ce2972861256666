"""From evidence to probabilities, and to the answer that costs least."""

from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cylforce.diagnosis.constants import (
    CORRELATED_ROWS,
    INCIDENT,
    SAME_EVIDENCE,
    SAME_MACHINE,
    SECOND_EFFECT,
    SPILL,
)
from cylforce.diagnosis.decide import (
    FreeEvidence,
    HypothesisEvidence,
    Verdict,
    as_simulated,
    costs,
    first_effect,
    one_answer,
)
from cylforce.diagnosis.likelihood import (
    TEMPERATURES,
    USUAL_CONDITIONS,
    Conditions,
    Form,
    Hypothesis,
    ResidualNoise,
    effective_share,
)
from cylforce.diagnosis.search import NO_GAP, UNKNOWN, BlockIncident, Candidate, Found, Spill
from cylforce.effects.unknown import NAME as UNKNOWN_TORQUE
from cylforce.readings.constants import HEALTHY, UNKNOWN_EFFECT

MASS, MOMENT, OTHER = ("extra_mass", "boom"), ("first_moment_change", "boom"), ("pressure_gain", "boom_head_pressure")
SLEW, CONTACT = ("slew_centrifugal", "machine"), ("soil_contact", "bucket")
SPILT = ("payload_spill", "bucket")
FORMS = tuple(Form(*key, (k,), 1.0, 10.0) for k, key in enumerate((MASS, MOMENT, OTHER)))
NOISE = ResidualNoise(np.ones(1), np.ones(1))
LOUD = ResidualNoise(np.full(1, 100.0), np.full(1, 5.0))
GAP = 5.0  # noise floors
BLOCKS = 100


def candidate(log, *forms, rest=None, noise=NOISE, known=FORMS):
    """Return a hypothesis of some of the known forms; the healthy machine has the gap as residual."""
    size, rest = np.ones(len(forms)), (1.0 if forms else GAP) if rest is None else rest
    return Candidate(Hypothesis(forms, log, noise, size, 0.1 * size, rest), SimpleNamespace(forms=known, laid=None))


def incident(key, log, share=0.1, rest=1.0, before=GAP):
    """Return something that happens in a share of the blocks."""
    sizes = (np.arange(BLOCKS) < share * BLOCKS).astype(np.float64)
    return BlockIncident(key, None, sizes, log, rest, before, None)


def evidence(*candidates, incidents=(), gap=GAP, forms=FORMS, healthy=None, places=1, spread=SAME_MACHINE, **more):
    """Return the evidence of hypotheses beside the healthy machine."""
    healthy = candidate(0.0, rest=gap) if healthy is None else healthy
    machine = SimpleNamespace(spread=spread)
    question = SimpleNamespace(forms=forms, incident_forms=Counter({SLEW[0]: 1, CONTACT[0]: places}), machine=machine)
    case = SimpleNamespace(machine=SimpleNamespace(noise=NOISE))
    return HypothesisEvidence(Found(question, case, (healthy, *candidates), tuple(incidents), np.array([gap])), **more)


def test_probabilities_add_up_to_one_and_follow_the_evidence():
    found = evidence(candidate(30.0, 0), candidate(20.0, 2))
    assert sum(found.posterior.values()) == pytest.approx(1.0)
    assert found.first == MASS
    assert found.credible == (MASS,)
    assert found.posterior[MASS] / found.posterior[OTHER] == pytest.approx(np.exp(10.0), rel=0.01)


def test_without_evidence_the_prior_is_all_there_is():
    """A machine is healthy with the stated probability; all names of the library share the remainder alike."""
    found = evidence(*(candidate(0.0, k) for k in range(3)), healthy=candidate(0.0, rest=1.0), gap=1.0)
    each = (1.0 - HEALTHY - UNKNOWN_EFFECT) / 5.0  # contact and slewing are names, too
    odds = found.posterior[NO_GAP] / found.posterior[OTHER]
    assert odds == pytest.approx(HEALTHY / each, rel=0.05)
    assert found.posterior[MASS] == pytest.approx(found.posterior[OTHER])


def test_an_effect_with_many_places_and_forms_is_no_more_probable_by_that():
    more = (*FORMS, *(Form("pressure_gain", f"{k}", (3 + k,), 1.0, 10.0) for k in range(9)))
    every = [candidate(0.0, k, known=more) for k in range(len(more))]
    found = evidence(*every, healthy=candidate(0.0, rest=1.0), gap=1.0, forms=more).posterior
    gains = sum(p for key, p in found.items() if key[0] == "pressure_gain")
    assert gains == pytest.approx(found[MASS], rel=0.01)


def test_a_second_effect_must_be_worth_its_prior():
    one, both = candidate(30.0, 0), candidate(31.0, 0, 2)
    found = evidence(one, both)
    assert found.prior_of(both) < found.prior_of(one) - 2.0
    assert found.weights.candidates[1] > found.weights.candidates[2]
    assert found.posterior[MASS] > 0.99  # both have it as the main effect


def test_the_main_effect_is_the_one_without_which_most_is_lost():
    found = evidence(candidate(500.0, 2), candidate(10.0, 0), candidate(520.0, 0, 1, 2))
    assert found.main(found.candidates[3]) == OTHER
    assert found.without(found.candidates[3], MASS) == 500.0
    assert found.best_of(OTHER) is found.candidates[3]


COLDER = replace(NOISE, conditions=Conditions(temperature=1.0))


def test_another_temperature_costs_the_prior_of_one_circumstance_more():
    assert sum(np.exp(c.log_prior) for c in TEMPERATURES) == pytest.approx(SECOND_EFFECT)
    assert all(c.log_prior == 0.0 for c in USUAL_CONDITIONS)
    assert COLDER.log_prior(NOISE) - NOISE.log_prior(NOISE) == pytest.approx(TEMPERATURES[0].log_prior)


def test_evidence_counts_less_beside_a_residual_that_nothing_explains():
    def log_odds(rest):
        found = evidence(candidate(40.0, 2, rest=rest))
        none, one = found.weights.candidates
        return np.log(one / none) - found.prior_of(found.candidates[1]) + np.log(HEALTHY)

    healthy = float(np.sqrt(1.0 + SAME_MACHINE))
    assert log_odds(0.9) == pytest.approx(40.0)
    assert log_odds(healthy) == pytest.approx(40.0)
    assert log_odds(1e3) == pytest.approx(40.0 / CORRELATED_ROWS, rel=1e-3)
    assert log_odds(1e3) < log_odds(2.0) < log_odds(1.5) < 40.0


def test_evidence_counts_less_with_references_whose_parts_hardly_predict_each_other():
    """Of two hypotheses that leave the same, the likelier one is less sure: what differs may be the references."""

    def odds(spread):
        found = evidence(candidate(40.0, 0), candidate(34.0, 2), spread=spread).posterior
        return np.log(found[MASS] / found[OTHER])

    assert odds(SAME_MACHINE) == pytest.approx(6.0, rel=0.01)
    assert odds(1e6) == pytest.approx(6.0 / CORRELATED_ROWS, rel=0.01)
    assert odds(16.0) < odds(4.0) < 6.0


def test_a_visible_residual_of_a_healthy_machine_may_hide_an_effect():
    """A gap that the healthy machine refits within its prior hides none, nor does contact that is hardly felt."""
    assert evidence().is_hidden
    assert not evidence(healthy=candidate(0.0, rest=1.5)).is_hidden
    assert evidence(incidents=[incident(CONTACT, 600.0, before=GAP)]).is_hidden
    assert not evidence(incidents=[incident(CONTACT, 600.0, before=1.5)]).is_hidden


def test_with_oil_of_another_temperature_evidence_counts_a_sixth():
    """References do not show that friction: structure of its law is model error."""
    colder = [candidate(300.0, 0, noise=COLDER), candidate(310.0, 0, 2, noise=COLDER)]
    assert evidence(*colder).strength == pytest.approx(1.0 / CORRELATED_ROWS)
    assert evidence(*colder, candidate(400.0, 2)).strength == pytest.approx(1.0)


@pytest.mark.parametrize(("rest", "first"), [(5.0, OTHER), (60.0, UNKNOWN)])
def test_a_law_leaves_a_share_of_a_large_gap_but_not_half_of_it(rest, first):
    """Beside a noise that no healthy machine has: a twentieth of the gap is the law's, half of it nothing known."""
    found = evidence(candidate(500.0, 2, rest=rest, noise=LOUD), gap=100.0)
    assert found.posterior[first] > 0.9


def test_the_more_a_machine_without_effects_leaves_the_less_is_it_healthy_except_at_work():
    """Its noise is usual; what counts is its residual beside those by which its own recordings differ."""

    def no_gap(rest, work=None, spread=SAME_MACHINE):
        found = evidence(healthy=candidate(0.0, rest=rest), spread=spread)
        return replace(found, found=replace(found.found, work=work)).posterior[NO_GAP]

    rests = (1.0, 1.3, 1.7, 2.0, 2.5, 3.0, GAP)
    assert np.all(np.diff([no_gap(rest) for rest in rests]) < 0.0)
    assert no_gap(1.3) > 0.95
    assert no_gap(2.5) < 0.2
    assert no_gap(GAP) < 1e-3
    assert no_gap(2.5, spread=10.0 * SAME_MACHINE) > 0.8
    assert no_gap(GAP, work=SimpleNamespace()) == pytest.approx(no_gap(1.0))


def test_an_effect_that_leaves_most_of_a_large_gap_is_not_the_cause_however_usual_its_noise():
    """With identified.toml alone the noise is hardly known: 5 of 8 floors were "usual", and a wrong name had 91 %."""
    assert evidence(candidate(200.0, 2, rest=5.0), gap=8.0).first == UNKNOWN
    assert evidence(candidate(200.0, 2, rest=1.5), gap=8.0).first == OTHER


# Incidents


def test_an_incident_with_many_places_is_no_more_probable_by_that():
    one, each = (
        evidence(incidents=[incident((CONTACT[0], str(n)), 10.0) for n in range(places)], places=places).posterior
        for places in (1, 3)
    )
    assert one[CONTACT[0], "0"] == pytest.approx(sum(each[CONTACT[0], str(n)] for n in range(3)))


@pytest.mark.parametrize("key", [SLEW, CONTACT, UNKNOWN])
def test_an_incident_with_evidence_is_named(key):
    found = evidence(incidents=[incident(key, 200.0)])
    assert (found.first, found.posterior[found.first]) == (key, pytest.approx(1.0))


@pytest.mark.parametrize("key", [UNKNOWN, CONTACT])
def test_a_transient_that_leaves_no_more_than_a_healthy_machine_does_is_no_gap(key):
    def found(before, **more):
        return evidence(
            incidents=[incident(key, 30.0, before=before)], gap=before, healthy=candidate(0.0, rest=before), **more
        )

    assert found(1.2).first == found(1.6).first == NO_GAP
    assert found(3.0).first == key
    assert found(3.0, spread=10.0 * SAME_MACHINE).first == NO_GAP
    assert [found(before).is_transient(found(before).incidents[0]) for before in (1.2, 3.0)] == [True, False]


def beside_contact(log, *forms, before=np.inf):
    """Return a hypothesis of some forms besides contact in some rows."""
    own = replace(candidate(log, *forms, rest=1.0), before=before)
    return replace(own, question=SimpleNamespace(forms=FORMS, laid=()))


def test_an_effect_besides_contact_has_to_be_likelier_than_the_contact_alone():
    """Rows without contact were searched for effects only: each named the effect by which they had been located."""

    def first(before, gain):
        rows = beside_contact(600.0, before=before), beside_contact(600.0 + gain, 2)
        return evidence(*rows, incidents=[incident(CONTACT, -5.0)]).first

    assert first(GAP, 1.0) == CONTACT
    assert first(1.2, 1.0) == NO_GAP
    assert first(1.2, 30.0) == OTHER


def test_contact_alone_has_a_prior_beside_free_parameters_too():
    free = FreeEvidence.of(evidence(beside_contact(600.0), beside_contact(601.0, 2)))
    assert free.priors[0] == 0.0  # other parameters and no effect
    assert free.priors[1] < np.log(SECOND_EFFECT)
    assert free.priors[2] < free.priors[1]


def test_contact_in_rows_is_that_of_the_likeliest_contact():
    near, far = incident(CONTACT, 1.0), incident(("soil_contact", "boom"), 300.0)
    assert evidence(beside_contact(600.0), incidents=[near, far], places=2).first == far.key


def test_a_visible_incident_is_none_of_a_healthy_machine_unless_its_references_differ_as_much():
    def share(before, spread=SAME_MACHINE):
        found = evidence(incidents=[incident(CONTACT, 600.0, before=before)], gap=before, spread=spread)
        return found.posterior[NO_GAP]

    assert share(3.0) < 0.1
    assert share(3.0, spread=2.0) < 0.5
    assert share(1.4, spread=2.0) == pytest.approx(1.0)


def spilt(loads):
    """Return spills of as many loads, no likelier by the rows than none."""
    odds = loads * float(np.log(INCIDENT / SPILL))
    sizes, course = np.ones((loads, 3)), np.ones((loads, BLOCKS))
    return Spill(SPILT, None, sizes, sizes, course, 0.0, odds, 1.0, GAP)


def test_each_spilt_load_counts_in_full_though_rows_beside_unknown_loads_count_a_sixth():
    work = evidence(incidents=[spilt(1)]).found
    found = [HypothesisEvidence(replace(work, incidents=(spilt(n),), work=SimpleNamespace())) for n in (1, 2, 8)]
    odds = [each.posterior[SPILT] / each.posterior[NO_GAP] for each in found]
    assert odds[1] / odds[0] == pytest.approx(INCIDENT / SPILL)
    assert odds[2] / odds[0] == pytest.approx((INCIDENT / SPILL) ** 7)


def test_spilt_loads_count_less_where_the_work_leaves_a_model_error():
    """An error of the laws is common to all loads: with cold oil a healthy machine's eleven nats named a spill."""
    work = evidence(incidents=[spilt(1)]).found

    def prior(rest, odds):
        each = HypothesisEvidence(work)
        return each.prior_of_incident(replace(spilt(1), rest=rest, odds=odds))

    for rest in (1.0, 1.3, 2.0, 5.0):
        assert prior(rest, 12.0) - prior(rest, 0.0) == pytest.approx(12.0 * effective_share(rest))


def test_a_transient_beside_a_lasting_effect_does_not_hide_it():
    contact = incident(CONTACT, 60.0)
    beside = replace(candidate(100.0, 2), incident=contact)
    found = evidence(candidate(40.0, 2), beside, incidents=[contact])
    assert found.first == OTHER
    assert found.best_of(OTHER) is found.candidates[2]


# Withdrawn causes


def test_without_a_cause_the_others_have_all_probability():
    """Bayes' rule among what remains."""
    told = evidence(
        candidate(100.0, 0), candidate(98.0, 2), candidate(120.0, 0, 2), incidents=[incident(CONTACT, 95.0)]
    )
    left = replace(told, withdrawn=frozenset({MASS}))
    assert [c.hypothesis.forms for c in left.candidates] == [(), (2,)]
    assert MASS not in left.posterior
    assert sum(left.posterior.values()) == pytest.approx(1.0)
    assert left.posterior[OTHER] > 0.5 > told.posterior[OTHER]
    odds = left.posterior[OTHER] / left.posterior[CONTACT]
    plain = evidence(candidate(98.0, 2), incidents=[incident(CONTACT, 95.0)]).posterior
    assert odds == pytest.approx(plain[OTHER] / plain[CONTACT])
    assert replace(left, withdrawn=frozenset({MASS, CONTACT})).incidents == []


def test_where_every_cause_is_withdrawn_something_unknown_remains():
    found = evidence(candidate(100.0, 0), withdrawn=frozenset({MASS}))
    assert first_effect(found) is None
    assert found.first == UNKNOWN


@pytest.mark.parametrize(
    ("ahead", "one"), [(SAME_EVIDENCE - 0.1, True), (-SAME_EVIDENCE + 0.1, True), (SAME_EVIDENCE + 0.1, False)]
)
def test_a_mass_and_a_first_moment_of_a_link_that_no_evidence_separates_are_one_answer(ahead, one):
    told = evidence(candidate(100.0 + ahead, 0), candidate(100.0, 1), candidate(90.0, 2))
    after, same = one_answer(told)
    first, other = (MASS, MOMENT) if ahead > 0.0 else (MOMENT, MASS)
    assert same == ({first: other} if one else {})
    assert (other in after.posterior) is not one
    assert sum(after.posterior.values()) == pytest.approx(1.0)
    if one:
        assert after.posterior[first] == pytest.approx(told.posterior[first] + told.posterior[other], abs=0.01)


def test_of_two_names_of_one_change_the_one_in_the_most_probable_hypothesis_stays():
    after, same = one_answer(evidence(candidate(100.0, 0), candidate(99.0, 1), candidate(150.0, 1, 2)))
    assert same == {MOMENT: MASS}
    assert {c.hypothesis.forms for c in after.candidates} == {(), (1,), (1, 2)}


def test_a_mass_beside_a_first_moment_in_the_most_probable_hypothesis_is_no_single_answer():
    told = evidence(candidate(100.0, 0), candidate(99.0, 1), candidate(150.0, 0, 1))
    assert one_answer(told) == (told, {})


def test_a_mass_and_a_first_moment_of_different_links_are_two_answers():
    forms = (FORMS[0], replace(FORMS[1], at="stick"), FORMS[2])
    assert one_answer(evidence(candidate(100.0, 0, known=forms), candidate(99.0, 1, known=forms), forms=forms))[1] == {}


# Costs


def with_posterior(first, rivals, none):
    """Return what `costs` reads of an evidence: probabilities, and the smallest set with nine tenths of them."""
    posterior = {("one", "a"): first, NO_GAP: none}
    posterior |= {("rival", str(k)): p for k, p in enumerate(rivals)}
    posterior[UNKNOWN] = 1.0 - sum(posterior.values())
    order, credible, mass = sorted(posterior, key=lambda key: -posterior[key]), [], 0.0
    for key in order:
        credible.append(key)
        mass += posterior[key]
        if mass >= 0.9:
            break
    return SimpleNamespace(posterior=posterior, credible=tuple(credible))


@pytest.mark.parametrize(("first", "rival", "none", "cheapest"), [
    (0.69, 0.03, 0.23, Verdict.AMBIGUOUS),  # nothing else may be it, but it is not as sure as a name must be
    (0.82, 0.0, 0.1, Verdict.EXPLAINED),
    (0.3, 0.05, 0.6, Verdict.NO_GAP),
    (0.05, 0.05, 0.1, Verdict.UNKNOWN),
    (0.5, 0.4, 0.05, Verdict.AMBIGUOUS),
    (0.0, 0.0, 0.9, Verdict.NO_GAP),
])  # fmt: skip
def test_the_answer_costs_least_and_one_name_alone_is_sure(first, rival, none, cheapest):
    found = costs(with_posterior(first, [rival] if rival else [], none), ("one", "a"))
    assert min(found, key=found.__getitem__) is cheapest
    assert (Verdict.EXPLAINED in found) == (first >= 0.8)


@pytest.mark.parametrize(
    ("verdict", "closure", "then"),
    [
        (Verdict.EXPLAINED, 0.49, Verdict.PARTLY),
        (Verdict.EXPLAINED, 0.51, Verdict.EXPLAINED),
        (Verdict.EXPLAINED, float("nan"), Verdict.EXPLAINED),
        (Verdict.AMBIGUOUS, 0.49, Verdict.AMBIGUOUS),
    ],
)
def test_a_cause_whose_simulation_leaves_most_of_the_gap_explains_it_in_part(verdict, closure, then):
    assert as_simulated(verdict, closure) is then


def test_a_set_of_many_is_no_better_than_unknown():
    """Two candidates are worth a look at each; ten that share the same probability are not."""
    two, ten = (costs(with_posterior(0.8 / n, [0.8 / n] * (n - 1), 0.1), ("one", "a")) for n in (2, 10))
    assert min(two, key=two.__getitem__) is Verdict.AMBIGUOUS
    assert min(ten, key=ten.__getitem__) is Verdict.UNKNOWN


def test_all_free_torques_are_one_unknown_cause():
    forms = (*FORMS, Form(UNKNOWN_TORQUE, "boom", (3,), 1.0, 10.0), Form(UNKNOWN_TORQUE, "stick", (4,), 1.0, 10.0))
    found = evidence(*(candidate(log, k, known=forms) for log, k in ((100.0, 3), (100.0, 4), (80.0, 2))), forms=forms)
    assert found.first == UNKNOWN
    assert set(found.posterior) == {NO_GAP, UNKNOWN, OTHER}
