"""The guidance: who does what it says is done within five minutes of motion; a load is refused meanwhile; what is asked
for is what is missing. (Twenty machines each: tools/accuracy commission.)"""

from functools import cache

import numpy as np
import pytest

from cylforce.commissioning import coverage, reaches
from cylforce.commissioning.coverage import Pace, Way, missing
from cylforce.commissioning.guidance import Guide, follow
from cylforce.commissioning.identification import identify
from cylforce.commissioning.strokes import Stroke, clear_range, next_stroke, reach_sentence, sentence
from cylforce.programs.common.readings import model_of
from cylforce.settings.machine_file import load
from obedient import commissioned
from scenarios import CONFIG, EXCAVATOR, SMALL
from spoilt import samples, touching

MACHINES = sorted(CONFIG.glob("*.toml"))
LOADED = load(EXCAVATOR)
MODEL = model_of(LOADED)
GUIDE = Guide(MODEL, every_s=10.0)
FEW = load(SMALL)  # two cylinders: half of the strokes
FEW_GUIDE = Guide(model_of(FEW), every_s=10.0)
FIVE_MINUTES = 300.0


@cache
def done(machine, seed=70):
    loaded = load(machine)
    return commissioned(loaded, Guide(model_of(loaded), every_s=20.0), seed)


@pytest.mark.parametrize("machine", MACHINES, ids=lambda path: path.stem)
def test_who_does_what_it_says_is_done_within_five_minutes(machine):
    told, _ = done(machine)
    last = told[-1]
    assert last.done
    assert last.refusal is None
    assert last.stroke is None
    assert last.seconds < FIVE_MINUTES
    assert last.weight_error < 0.01 * load(machine).service.machine.rated_payload
    assert all(not advice.done for advice in told[:-1])


@pytest.mark.parametrize("machine", MACHINES, ids=lambda path: path.stem)
def test_what_it_ended_with_is_accepted_by_identify_and_tells_all_weights(machine):
    _, values = done(machine)
    found = identify(model_of(load(machine)), [values])
    moments = {f"{link.name}.{symbol}" for link in found.model.machine.links[-2:] for symbol in "XZ"}
    assert not moments & set(found.not_identified)


def test_a_recording_is_followed_as_the_bus_was():
    told, values = done(SMALL)
    advice = list(follow(FEW_GUIDE, [values]))
    assert advice[-1].done
    assert advice[-1].seconds == pytest.approx(told[-1].seconds, abs=6.0)
    shares = [np.minimum(a.covered, FEW_GUIDE.plan.needed).sum() for a in advice]
    assert np.all(np.diff(shares) >= 0.0)


def test_the_same_samples_give_the_same_advice_and_leave_the_state_alone():
    _, values = done(EXCAVATOR)
    state = GUIDE.take(GUIDE.begin(), values[:3000])
    before = state.covered.copy()
    first, second = (GUIDE.advice(GUIDE.take(state, values[3000:6000])) for _ in range(2))
    assert first.instruction == second.instruction
    np.testing.assert_array_equal(first.covered, second.covered)
    np.testing.assert_array_equal(state.covered, before)


def test_pieces_of_any_size_and_bridged_gaps_cover_the_same():
    _, values = done(EXCAVATOR)
    whole = GUIDE.take(GUIDE.begin(), values[:4000])
    pieces = GUIDE.begin()
    for first in range(0, 4000, 137):
        pieces = GUIDE.take(pieces, values[first : min(first + 137, 4000)])
    np.testing.assert_allclose(pieces.covered, whole.covered, atol=0.05)
    torn = values[:4000].copy()
    torn[1000:1003] = np.nan
    gapped = GUIDE.absorb(GUIDE.begin(), torn, 5)
    np.testing.assert_allclose(gapped.covered, whole.covered, atol=0.05)
    torn[1000:1300] = np.nan
    lost = GUIDE.absorb(GUIDE.begin(), torn, 5)
    assert lost.moved_s < whole.moved_s - 3.0
    assert len(GUIDE.absorb(whole, torn[1000:1300], 5).tail) == 0


@pytest.mark.parametrize("kg", [300.0, pytest.param(1500.0, marks=pytest.mark.long)])
def test_a_loaded_bucket_is_refused_early(kg):
    told, _ = commissioned(FEW, FEW_GUIDE, 71, kg)
    assert told[-1].seconds < 60.0
    assert told[-1].refusal.startswith("the bucket is not empty")
    assert told[-1].instruction == told[-1].refusal


def test_a_tool_on_the_ground_is_refused():
    *_, last = follow(Guide(FEW_GUIDE.model, every_s=40.0), [samples(FEW, 72, effects=touching(0.1, 10e3))])
    assert "something" in last.refusal


def test_a_joint_that_does_not_move_is_asked_for():
    values = samples(LOADED, 73, seconds=150.0)
    k = [s.name for s in MODEL.machine.signals].index("bucket_angle")
    noise = np.random.default_rng(1).normal(0.0, MODEL.machine.signals[k].standard_error, len(values))
    turned = values[:, k] - values[0, k]
    still = values[:10000][np.abs(turned[:10000]) < 1.0]
    still[:, k] = values[0, k] + noise[: len(still)]
    told = [a.instruction for a in follow(Guide(MODEL, every_s=1e6), [still]) if a.seconds > 62.0]
    assert told[-1].startswith("the bucket has not moved yet: move it both ways")


def test_creeping_is_told():
    machine = MODEL.machine
    t = np.arange(6000) / 100.0
    values = np.tile(samples(LOADED, 73, seconds=20.0)[0], (len(t), 1))
    k = [s.name for s in machine.signals].index("boom_angle")
    values[:, k] += 0.002 * t
    *_, last = follow(GUIDE, [values])
    assert last.instruction.startswith("move faster: cylinders below 4 mm/s")


def test_the_first_stroke_is_slow_and_the_next_one_goes_back():
    plan, machine = GUIDE.plan, MODEL.machine
    nobody_knows = np.full(machine.size, np.nan)
    first = next_stroke(machine, plan, np.zeros_like(plan.needed), nobody_knows, None)
    assert first.pace is Pace.SLOW
    made = np.zeros_like(plan.needed)
    made[first.joint, :, first.way, Pace.SLOW] = 2.0
    posture = first.hold.copy()
    posture[first.joint] = first.end
    second = next_stroke(machine, plan, made, posture, first)
    assert (second.joint, second.pace, second.way) == (first.joint, Pace.SLOW, Way(1 - first.way))


def test_only_what_is_missing_is_asked_for():
    plan, machine = GUIDE.plan, MODEL.machine
    enough = plan.needed + 1.0
    assert next_stroke(machine, plan, enough, np.zeros(3), None) is None
    enough[1, 2:4, Way.RETRACTING, Pace.FAST] = 0.0
    stroke = next_stroke(machine, plan, enough, np.zeros(3), None)
    (gap,) = missing(plan, enough)
    assert (stroke.joint, stroke.way, stroke.pace) == (1, Way.RETRACTING, Pace.FAST)
    assert min(stroke.begin, stroke.end) < gap.low < gap.high < max(stroke.begin, stroke.end)
    says = sentence(machine, plan, stroke)
    assert says.startswith("move the stick fast: its cylinder in from ")
    assert "the boom's at" in says


def test_lifting_joints_are_asked_for_the_upper_half_only():
    machine = MODEL.machine
    low, high = clear_range(machine)[0]
    assert low > machine.links[0].angle_low + 0.4 * (high - machine.links[0].angle_low)
    assert GUIDE.plan.edges[0, 0] == low


def test_all_joints_move_at_once_until_nine_tenths_of_the_postures_were_visited():
    """Going where it says always ends, visits what was not visited, and never asks for the same posture twice in a
    row once it was reached."""
    machine, plan = MODEL.machine, GUIDE.plan
    places = reaches.postures(machine, plan)
    seconds, posture, asked = np.zeros(places.pairs.shape), np.full(machine.size, np.nan), []
    while (
        reach := reaches.next_reach(machine, plan, places, seconds, posture, asked[-1] if asked else None)
    ) is not None:
        assert not asked or np.any(reach.target != asked[-1].target)
        asked.append(reach)
        posture = reach.target
        before = reaches.visited(places, seconds)
        seconds = seconds + coverage.planes(plan, posture[None], np.ones((1, len(machine.cylinders))), 1.0)
        assert reaches.visited(places, seconds) > before
    assert reaches.visited(places, seconds) >= reaches.ENOUGH
    assert len(asked) <= np.count_nonzero(places.pairs)


def test_a_reach_holds_until_it_was_reached():
    machine, plan = MODEL.machine, GUIDE.plan
    places = reaches.postures(machine, plan)
    nothing, anywhere = np.zeros(places.pairs.shape), plan.edges.mean(axis=1)
    first = reaches.next_reach(machine, plan, places, nothing, anywhere, None)
    assert reaches.next_reach(machine, plan, places, nothing, anywhere, first) is first
    says = reach_sentence(machine, plan, first)
    assert says.startswith("move all joints at once, in about ")
    assert says.count("'s cylinder to") == 3


def test_single_strokes_come_before_all_at_once():
    told, _ = done(EXCAVATOR)
    kinds = [type(advice.stroke) for advice in told if advice.stroke is not None]
    first = kinds.index(reaches.Reach)
    assert first > 0
    assert set(kinds[:first]) == {Stroke}
