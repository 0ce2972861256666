"""Numbers that leave the service, or stand in logs: they never change."""

from dataclasses import replace

from cylforce.estimation.kernel import inputs
from cylforce.programs.live.sensor_messages import CODES, LEVELS, WHY
from cylforce.programs.run import WHY_MISSED
from cylforce.service.booking import MissedReason
from cylforce.service.plausibility.suspicion import LATCHED, LATCHED_IF_CONFIRMED, Level, SensorFault, SensorSuspicion
from cylforce.signals.estimate import Reason, Status

REASONS = (
    *("NONE", "STARTING", "SIGNAL_MISSING", "SIGNAL_STALE", "OUT_OF_RANGE", "NOT_A_NUMBER", "FROZEN"),
    *("IMPLAUSIBLE_JUMP", "SHORT_FRAME", "LONG_FRAME", "TIME_JUMP", "OVERRUN", "DEAD_POINT", "END_STOP", "SINGULAR"),
    *("AT_REST", "IN_CONTACT", "NOT_A_LOAD", "UNCERTAIN", "OUT_OF_DECLARED_RANGE", "TILT", "SLEWING"),
    *("NOT_OPERATIONAL", "NOT_IDENTIFIED", "NOT_THIS_MACHINE", "NO_CONTACT", "OTHER_TOOL", "NOT_CURLED"),
    *("SENSORS_DISAGREE", None, "TWO_PRODUCERS", "OWN_IDENTIFIER", "NOT_CONFIRMED"),
)
FAULTS = (
    "NONE",
    "FROZEN",
    "BURST",
    "OFFSET",
    "SLIPPED",
    "CONTRADICTS_MOTION",
    "ANGLE_STEPPED",
    "BELOW_VACUUM",
    "NEGATIVE_WEIGHT",
    "STEPPED",
    "SWAPPED",
    "BACK_IN_RANGE",
    "IMPOSSIBLE_MOMENTS",
)


def test_every_sensor_fault_has_a_code_and_a_sentence():
    """A detector that reports a new fault adds it in both tables, or the daemon could not report it."""
    faults = set(SensorFault) - {SensorFault.NONE}
    assert set(CODES) == set(WHY) == faults
    assert all(0xFF10 <= code <= 0xFFFF for code in CODES.values())


def test_the_words_of_the_journal_for_levels_never_change():
    assert {level.name: word for level, word in LEVELS.items()} == {"SUSPECTED": "doubted", "REJECTED": "rejected"}


def test_every_reason_of_a_missed_load_has_a_sentence():
    assert set(WHY_MISSED) == set(MissedReason)
    assert len(set(WHY_MISSED.values())) == len(MissedReason)


def test_reasons_and_status_have_the_numbers_of_the_chapter():
    assert {r.name: r.value for r in Reason} == {name: k for k, name in enumerate(REASONS) if name}
    assert {s.name: s.value for s in Status} == {"OK": 0, "DEGRADED": 1, "HOLD": 2, "INVALID": 3}


def test_the_kernel_knows_reasons_by_the_same_numbers():
    names = {"STALE": "SIGNAL_STALE", "JUMPED": "IMPLAUSIBLE_JUMP", "SHORT": "SHORT_FRAME", "GOOD": "NONE"}
    same = ("OUT_OF_RANGE", "NOT_A_NUMBER", "FROZEN", "NOT_OPERATIONAL", "TWO_PRODUCERS")
    for name, reason in {**names, **{name: name for name in same}}.items():
        assert getattr(inputs, name) == Reason[reason]


def test_suspicions_are_told_by_their_numbers():
    assert {f.name: f.value for f in SensorFault} == {name: k for k, name in enumerate(FAULTS)}
    assert {level.name: level.value for level in Level} == {"FINE": 0, "SUSPECTED": 1, "REJECTED": 2}


def test_what_a_suspicion_means_for_the_work():
    """Bookings wait for what the next motion will say; what is latched stays until the next start, what is concluded
    from many samples only once motion in both directions has confirmed it; an empty bucket below nothing may be a
    drift."""
    every = [SensorSuspicion(level, cause) for level in Level for cause in SensorFault]
    confirmed = [replace(suspicion, confirmed=True) for suspicion in every]
    assert {d.cause for d in confirmed if d.latched} == {*LATCHED, *LATCHED_IF_CONFIRMED}
    assert {d.cause for d in every if d.stays} == {*LATCHED, SensorFault.CONTRADICTS_MOTION}
    assert {d.cause.name for d in every if d.waits} == {"STEPPED", "SWAPPED", "BACK_IN_RANGE"}
    assert {d.cause for d in every if d.latched} == set(LATCHED)
    assert {d.level for d in every if d.latched} == {Level.REJECTED}
    assert {d.cause.name for d in every if d.follows and d.level is not Level.FINE} == {"NEGATIVE_WEIGHT"}


def test_a_level_begins_above_its_limit():
    limits = {Level.SUSPECTED: 2.0, Level.REJECTED: 4.0}
    assert [Level.of(x, limits).name for x in (2.0, 2.1, 4.0, 4.1)] == ["FINE", "SUSPECTED", "SUSPECTED", "REJECTED"]
