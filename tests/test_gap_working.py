"""A machine at work whose load is known in one of its recordings, and changes there."""

from dataclasses import replace

import numpy as np
import pytest

from cylforce.diagnosis.answer.learnt import CALIBRATION
from cylforce.diagnosis.answer.shrinkage import AT_WORK, tried
from cylforce.diagnosis.answer.verdict import Verdict, judged, searched
from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.inference import search
from cylforce.diagnosis.inference.posterior import Asked, Happened
from cylforce.diagnosis.inference.search import examined
from cylforce.effects.fault import PRESSURES
from cylforce.effects.imposed import imposed
from cylforce.programs.common.gap_answer import answer
from cylforce.programs.reports.gap_page import gap_page
from cylforce.programs.wording.plain import plain
from cylforce.simulation.scenario import cycles
from cylforce.simulation.sensing import run, sensors
from cylforce.simulation.simulator import draw_truth
from gap_scene import LOADS, MACHINE, SERVICE, as_it_was, recordings

SEED = 3
WORK_S, REST_S = 6.0, 4.0  # in turns: the teeth in the ground, nothing touches it
ORIGIN = {
    "machine": "M",
    "date": "2026-11-26T00:00",
    "field": [],
    "reference": [],
    "identified": [],
    "version": "",
    "machine_sha256": "",
}
SPILL = (-400.0, -400.0, 0.0)  # kg, kg m, of the known load


LIFTED_S, DUMPED_S = 8.6, 11.3  # of a cycle of digging


def at_work(recorded, rng):
    """Pressures that no load and no single force at the teeth explains, in turns with the machine in the air."""
    rate = 100.0
    t = np.arange(len(recorded.values)) / rate
    own = [k for k, s in enumerate(MACHINE.signals) if s.kind in PRESSURES]
    waves = np.sin(2.0 * np.pi * np.outer(t, rng.uniform(0.3, 0.9, len(own))) + rng.uniform(0.0, 6.0, len(own)))
    values = recorded.values.copy()
    values[:, own] += 3e6 * np.where((t % (WORK_S + REST_S) < WORK_S)[:, None], waves, 0.0)
    return recorded._replace(values=values)


def test_work_with_a_known_load_that_falls_out_is_answered():
    rng, reference = np.random.default_rng(SEED), as_it_was()
    spill = imposed(MACHINE, "payload_spill", "bucket", SPILL, begin=105.0)
    field = [at_work(each, rng) for each in recordings(SEED, (spill,))]
    assert [each.load for each in field] == list(LOADS)
    found = examined(reference.viewer, field, reference.clean, rng)
    assert found.working, f"seed {SEED}"
    assert {form.name for form in found.asked.forms}.isdisjoint({"payload_spill", "payload_shift"})


def dug(kg):
    """Five cycles of digging, of whose loads `kg` fall out as they are lifted, if any do."""
    scenes = list(cycles(MACHINE, np.random.default_rng(SEED), 5, swing=False))
    begins = np.cumsum([scene.duration for scene in scenes])[:-1]
    lost = (-kg, -kg, 0.0)
    times = [(begin + LIFTED_S, begin + DUMPED_S) for begin in begins.tolist()] if kg else []
    spills = tuple(imposed(MACHINE, "payload_spill", "bucket", lost, begin=begin, end=end) for begin, end in times)
    truth, dt = draw_truth(MACHINE, np.random.default_rng(0), 0.1), 1.0 / SERVICE.filters.rate_hz
    made, rng = sensors(MACHINE, SERVICE.nodes), np.random.default_rng((SEED, 9))
    each = run(MACHINE, truth._replace(effects=spills), made, scenes, dt=dt, rng=rng)
    return Recorded("dug", np.concatenate([record.values for record in each]), 0.0)


def test_what_references_show_at_nothing_but_work_works(monkeypatch):
    """Half a minute of work tells too little of the machine for any judgement whether it works: without an effect,
    something unknown was found with 9 floors. In the air it is not at work all the same."""
    monkeypatch.setattr(search, "GAP", 1e3)  # as if what was found explained everything
    rng, reference = np.random.default_rng(SEED), as_it_was()
    work = [r._replace(counts=np.arange(len(r.values) // 5) % 200 < 60) for r in recordings(1)]
    rest = work[1]._replace(values=np.tile(work[1].values[:1], (2000, 1)), counts=np.ones(400, dtype=np.bool_))
    work.append(rest)  # a part of it waits, which is no other recording
    only = ("viscous_friction", "stick")
    assert examined(reference.viewer, [dug(0.0)], work, rng, only=only).working
    assert not examined(reference.viewer, recordings(SEED), work, rng, only=only).working
    assert not examined(reference.viewer, [dug(0.0)], [*work[:1], recordings(1)[1]], rng, only=only).working


def test_at_work_contact_is_not_set_aside(monkeypatch):
    """It is told with the loads: beside it alone, these would look like something that lasts."""
    rng, reference = np.random.default_rng(SEED), as_it_was()
    contact = Happened(("soil_contact", "bucket"), 0.0, 0.1, 9.0)
    monkeypatch.setattr(search, "likelier", lambda question, *_: (contact, np.arange(len(question.problem.times)) < 5))
    monkeypatch.setattr(Asked, "lasts", True)
    found = examined(reference.viewer, [dug(0.0)], reference.clean, rng)
    assert (found.working, found.asked.incident, found.question.aside) == (True, None, None)


@pytest.mark.parametrize("kg", [0.0, 80.0])
def test_what_falls_out_of_an_unknown_load_is_weighed(kg):
    rng, reference = np.random.default_rng(SEED), as_it_was()
    found = examined(reference.viewer, [dug(kg)], reference.clean, rng, only=("payload_spill", ""))
    assert found.working, f"seed {SEED}"
    assert (found.lost is not None) == (kg > 0.0)
    if found.lost:
        assert len(found.lost.sizes) >= 3  # of five: a stretch of half a second may be too short
        assert np.all(np.abs(found.lost.sizes[:, 0] + kg) < 4.0 * found.lost.errors[:, 0])
        assert found.lost.happened.log > found.asked.none.log
        (cause,) = searched(found, at_work=None).causes
        assert (cause.key, cause.when) == (("payload_spill", "bucket"), f"{len(found.lost.sizes)} times")
        assert cause.size == pytest.approx(-kg, abs=10.0)


def test_a_cause_that_work_does_not_hide_is_named_without_a_share():
    """Of the gap of a machine at work, which is contact, no effect takes away anything; weights hold the loads. As if
    a machine in the air worked."""
    rng, reference = np.random.default_rng(SEED), as_it_was()
    late = imposed(MACHINE, "sensor_delay", "bucket_angle", 0.06)
    found = replace(examined(reference.viewer, recordings(SEED, (late,)), reference.clean, rng), working=True)
    causes = searched(found, at_work=CALIBRATION)
    _, verdict, size, warning = tried(causes, judged(found, causes), rng)
    told = answer(causes, verdict, size, (), {})
    assert [(each["name"], each["at"]) for each in told["effects"]] == [("sensor_delay", "bucket_angle")]
    assert told["effects"][0]["closure"] == {"value": None, "low": None, "high": None}
    assert (told["working"], told["end_quantities"], told["explained"], warning) == (True, None, None, AT_WORK)
    assert (told["gap"]["simulated"], told["effects"][0]["removed_nm"]) == ([], None)
    page = gap_page((causes, verdict, size), told, plain(MACHINE, told), ORIGIN)
    assert "How large the gap is" in page
    assert "after, bar" not in page
    said = plain(MACHINE, told)
    assert {"What it does", "Once corrected"}.isdisjoint(point.title for point in said.points)


def test_at_work_no_gap_and_something_unknown_are_not_observable():
    rng, reference = np.random.default_rng(SEED), as_it_was()
    found = replace(examined(reference.viewer, recordings(SEED), reference.clean, rng), working=True)
    told = judged(found, searched(found, at_work=CALIBRATION))
    assert (told.verdict, told.named) == (Verdict.NOT_OBSERVABLE, ())


def test_a_check_up_beside_a_working_recording_counts_in_full():
    """Work is a property of each recording. Beside an unknown load a mass on the tool cannot be seen, and was not even
    asked; a check-up with an empty bucket shows it, whatever the other recording is of."""
    reference, true = as_it_was(), ("extra_mass", "bucket")
    effect = imposed(MACHINE, *true, (80.0, 0.0, 0.0, 0.0))
    check_up = recordings(SEED, (effect,))[0]._replace(name="check-up")
    work = at_work(recordings(SEED + 1, (effect,))[0], np.random.default_rng(SEED))._replace(name="work")

    def nats(*field):
        rng = np.random.default_rng(SEED)
        found = examined(reference.viewer, list(field), reference.clean, rng, only=true)
        return found.working, found.asked.alone[true][0] - found.asked.none.log

    alone, both = nats(check_up), nats(work, check_up)
    assert (alone[0], both[0]) == (False, True), f"seed {SEED}"
    assert both[1] > 0.9 * alone[1], f"seed {SEED}: {both[1]:.0f} nats instead of {alone[1]:.0f}"
