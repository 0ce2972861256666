"""The noise of sensors, told from recordings of a moving machine."""

import numpy as np
import pytest

from cylforce.readings.noise import noise_warning, sensor_noise, white_noise
from cylforce.readings.recording import Recording
from readings.scenes import MACHINE

DECLARED = np.array([s.standard_error for s in MACHINE.signals])
T = np.arange(6000) * 0.01


def recorded(times, seed):
    """A minute in which everything swings by 1000 times its noise, slowly; noise `times` what is declared."""
    swing = 1e3 * np.sin(2.0 * np.pi * 0.1 * T)[:, None]
    noise = np.random.default_rng(seed).standard_normal((len(T), len(DECLARED)))
    return Recording("moves", DECLARED * (swing + times * noise), 0.0)


def told(field, references):
    return noise_warning(sensor_noise(MACHINE, field, references))


def test_noise_is_told_while_the_machine_moves():
    assert white_noise([recorded(np.ones(len(DECLARED)), 1)]) == pytest.approx(DECLARED, rel=0.08)


def test_the_sensor_that_shakes_is_named_alone():
    usual, shakes = np.ones(len(DECLARED)), np.ones(len(DECLARED))
    shakes[-1] = 6.0
    words = told([recorded(shakes, 2)], [recorded(usual, 3)])
    assert words.count("times as much") == 1
    assert f"{MACHINE.signals[-1].name} " in words
    assert told([recorded(usual, 4)], []) == ""


def test_a_sensor_that_was_always_noisy_is_not_named():
    noisy = np.full(len(DECLARED), 6.0)
    assert told([recorded(noisy, 5)], [recorded(noisy, 6)]) == ""


def test_a_single_glitch_is_no_noise():
    field = recorded(np.ones(len(DECLARED)), 7)
    field.values[3000, 0] += 1e4 * DECLARED[0]
    assert told([field], []) == ""


def test_every_sensor_is_told_with_what_it_declares_and_showed_before():
    shakes = np.ones(len(DECLARED))
    shakes[-1] = 6.0
    rows = sensor_noise(MACHINE, [recorded(shakes, 8)], [recorded(np.ones(len(DECLARED)), 9)])
    assert {row.sensor for row in rows} == {s.name for s in MACHINE.signals}
    assert [row.shakes for row in rows] == [True] + [False] * (len(rows) - 1)
    assert rows[0].seen == pytest.approx(6.0 * rows[0].declared, rel=0.1)
    assert rows[0].before == pytest.approx(rows[0].declared, rel=0.1)
    assert sensor_noise(MACHINE, [recorded(shakes, 8)], [])[0].before is None
