"""Jumps of a reading, found in the raw readings."""

import numpy as np
import pytest

from cylforce.effects.sensors.intermittent_glitch import IntermittentGlitch
from cylforce.readings.jumps import jumping_sensors
from cylforce.readings.recording import Recording
from machines import excavator

RATE = 100.0


@pytest.fixture(scope="module")
def machine():
    return excavator()


def readings(machine, seed, seconds=120.0):
    """Slow motion within every signal's range, with noise."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, seconds, 1.0 / RATE)
    columns = []
    for k, s in enumerate(machine.signals):
        width = s.high - s.low
        wave = np.sin(2.0 * np.pi * (0.05 + 0.01 * k) * t + k)
        columns.append((s.low + s.high) / 2.0 + 0.2 * width * wave + 1e-4 * width * rng.standard_normal(len(t)))
    return np.stack(columns, axis=-1)


def recorded(values):
    return Recording("field", values, 0.0)


def test_a_machine_in_order_has_none(machine):
    field, reference = recorded(readings(machine, 1)), recorded(readings(machine, 2))
    assert jumping_sensors(machine, [field], [reference], RATE) == ()


def test_the_sensor_that_jumps_is_found_and_what_is_found_takes_the_jumps_out_again(machine):
    plain = readings(machine, 1)
    k = next(k for k, s in enumerate(machine.signals) if "angle" in s.name)
    t = np.arange(len(plain)) / RATE
    values = IntermittentGlitch(every=6.0).distorted(machine, plain, t, k, 0.1)
    (found,) = jumping_sensors(machine, [recorded(values)], [recorded(readings(machine, 2))], RATE)
    assert (found.proposal.name, found.proposal.where) == ("intermittent_glitch", k)
    again = found.proposal.group[0].distorted(machine, values, t, k, -0.1)
    width = machine.signals[k].high - machine.signals[k].low
    assert np.sqrt(np.mean((again - plain) ** 2)) < 0.2 * np.sqrt(np.mean((values - plain) ** 2))
    assert np.mean(np.abs(again - plain) > 0.01 * width) < 0.1 * np.mean(np.abs(values - plain) > 0.01 * width)


def test_one_that_always_jumped_so_often_is_no_news(machine):
    k = next(k for k, s in enumerate(machine.signals) if "angle" in s.name)
    both = []
    for seed in (1, 2):
        plain = readings(machine, seed)
        t = np.arange(len(plain)) / RATE
        both.append(recorded(IntermittentGlitch(every=6.0, seed=seed).distorted(machine, plain, t, k, 0.1)))
    assert jumping_sensors(machine, both[:1], both[1:], RATE) == ()


def test_what_jumps_together_is_a_knock(machine):
    plain = readings(machine, 1)
    t, values = np.arange(len(plain)) / RATE, plain
    for k in [k for k, s in enumerate(machine.signals) if "pressure" in s.name]:
        values = IntermittentGlitch(every=6.0).distorted(machine, values, t, k, 0.1)
    assert jumping_sensors(machine, [recorded(values)], [recorded(readings(machine, 2))], RATE) == ()


def test_without_references_nothing_is_concluded(machine):
    assert jumping_sensors(machine, [recorded(readings(machine, 1))], [], RATE) == ()
