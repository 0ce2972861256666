"""Vibration of the engine, told from the raw readings of a moving machine: at its frequency, with its size, in the
sensors that show it; none on machines in order."""

from dataclasses import replace

import numpy as np
import pytest

from cylforce.readings.constants import FALSE_LINES
from cylforce.readings.recording import Recording
from cylforce.readings.vibration import Vibration, spectra, vibration_warning, vibrations
from cylforce.signals.kinds import Kind
from readings.scenes import MACHINE, SERVICE, recordings

FILTERS = SERVICE.filters
NAMES = [s.name for s in MACHINE.signals]
DECLARED = np.array([s.standard_error for s in MACHINE.signals])
PRESSURES = [k for k, s in enumerate(MACHINE.signals) if s.kind in (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)]
PITCH = next(k for k, s in enumerate(MACHINE.signals) if s.kind is Kind.PITCH)
SHAKEN = [*PRESSURES, PITCH]
HZ, TIMES = 37.0, 2.0  # a vibration of twice the declared noise


def shaken(each, hz=HZ, times=TIMES, which=SHAKEN, wander=0.0):
    """Recordings with a vibration added to some sensors, whose speed wanders by so many Hz."""
    found = []
    for recorded in each:
        values, t = recorded.values.copy(), np.arange(len(recorded.values)) / FILTERS.rate_hz
        phase = 2.0 * np.pi * (hz * t + wander / 0.6 * np.sin(0.6 * t))
        for k in which:
            values[:, k] += times * DECLARED[k] * np.sin(phase + k)
        found.append(replace(recorded, values=values))
    return found


def told(field, references=()) -> list[Vibration]:
    return vibrations(MACHINE, FILTERS, field, references)


@pytest.fixture(scope="module")
def order():
    return recordings(2)


@pytest.fixture(scope="module")
def references():
    return recordings(1)


@pytest.mark.parametrize(("hz", "seen"), [(37.0, 37.0), (60.0, 40.0), (90.0, 10.0)])
def test_a_vibration_is_told_with_its_frequency_sensors_and_size(order, references, hz, seen):
    """A faster one at the frequency at which samples show it."""
    (found,) = told(shaken(order, hz), references)
    assert found.frequency_hz == pytest.approx(seen, abs=0.5)
    assert {line.sensor for line in found.sensors} == {NAMES[k] for k in SHAKEN}
    for line in found.sensors:
        assert line.grew
        assert line.amplitude == pytest.approx(TIMES * DECLARED[NAMES.index(line.sensor)], rel=0.15)


def test_an_engine_whose_speed_wanders_is_found(order, references):
    (found, *_) = told(shaken(order, wander=0.5), references)
    assert found.frequency_hz == pytest.approx(HZ, abs=1.0)
    assert len(found.sensors) == len(SHAKEN)


def test_the_sentence_names_frequency_and_what_samples_cannot_distinguish(order, references):
    words = vibration_warning(told(shaken(order), references), FILTERS.rate_hz)
    assert "37.0 Hz (or 63.0 Hz" in words
    assert all(f"{NAMES[k]} " in words for k in SHAKEN)


def test_a_vibration_that_was_always_there_is_told_but_no_reason_to_warn(order, references):
    found = told(shaken(order), shaken(references))
    assert len(found) == 1
    for line in found[0].sensors:
        assert line.before == pytest.approx(line.amplitude, rel=0.15)
    assert vibration_warning(found, FILTERS.rate_hz) == ""


def test_without_references_nothing_has_grown(order):
    (found,) = told(shaken(order))
    assert {(line.before, line.grew) for line in found.sensors} == {(None, False)}


def test_one_sensor_alone_does_not_tell_a_vibration(order, references):
    assert told(shaken(order, which=[PITCH]), references) == []


def test_one_that_drowns_in_the_sensors_noise_is_not_told(order, references):
    assert told(shaken(order, times=0.5), references) == []


def test_motion_meanwhile_does_not_hide_its_size(order, references):
    """Where the background of some stretches is a thousand times as large, the others tell."""
    loud = [replace(each, values=each.values.copy()) for each in order]
    noise = np.random.default_rng(5).standard_normal((2000, len(DECLARED)))
    for each in loud:
        each.values[1000:3000] += 30.0 * DECLARED * noise
    (found,) = told(shaken(loud), references)
    for line in found.sensors:
        assert line.amplitude == pytest.approx(TIMES * DECLARED[NAMES.index(line.sensor)], rel=0.15)


def test_what_the_service_passes_is_no_vibration(order, references):
    """There, motion has lines, too, and the diagnosis sees what is in the torques."""
    assert told(shaken(order, 0.8 * FILTERS.channel_hz), references) == []


def test_machines_in_order_show_none(order):
    assert told(order, recordings(3)) == []
    assert told(recordings(4)) == []


def test_noise_alone_shows_no_more_lines_than_is_said():
    minutes = [
        Recording("noise", DECLARED * np.random.default_rng(seed).standard_normal((6000, len(DECLARED))), 0.0)
        for seed in range(40)
    ]
    assert sum(len(told([each])) for each in minutes) <= 1 + 3 * len(minutes) * FALSE_LINES


def test_a_knock_and_a_dead_sensor_are_none(order):
    knocked = [replace(each, values=each.values.copy()) for each in order]
    for each in knocked:
        each.values[3000:3010, SHAKEN] += 50.0 * DECLARED[SHAKEN]
        each.values[:, PITCH] = 0.0
    assert told(knocked) == []


def test_less_than_a_stretch_tells_nothing():
    assert spectra(FILTERS, DECLARED, [Recording("short", np.zeros((100, len(DECLARED))), 0.0)]) is None
    assert told([Recording("short", np.zeros((100, len(DECLARED))), 0.0)]) == []
