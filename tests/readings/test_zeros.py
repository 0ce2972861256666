"""Zeros of pressure sensors, read without pressure, are evidence for a wrong zero or against it."""

import numpy as np
import pytest

from cylforce.readings.zeros import HEALTHY_PA, read_zeros
from cylforce.settings.machine_file import load
from scenarios import CONFIG

MACHINE = load(CONFIG / "excavator_20t.toml").service.machine
HEAD = next(k for k, s in enumerate(MACHINE.signals) if s.name == "stick_head_pressure")


def read(pressure, noise=0.1e5):
    values = noise * np.random.default_rng(1).standard_normal((1000, len(MACHINE.signals)))
    values[:, HEAD] += pressure
    return read_zeros(MACHINE, values)


def test_the_mean_has_the_standard_error_of_white_noise():
    zero = read(2e5).by_signal[HEAD]
    assert zero.mean == pytest.approx(2e5, abs=0.02e5)
    assert 0.3 < zero.error / (0.1e5 / np.sqrt(1000)) < 3.0


def test_slow_noise_makes_the_mean_less_certain():
    """A mean over ten seconds of a reading that wanders is no more exact than the wandering allows."""
    values = np.zeros((1000, len(MACHINE.signals)))
    values[:, HEAD] = 1e5 * np.sin(np.linspace(0.0, 2.0 * np.pi, 1000))
    assert read_zeros(MACHINE, values).by_signal[HEAD].error > 0.1e5


@pytest.mark.parametrize("offset", [1e5, -2e5])
def test_a_zero_is_evidence_for_its_offset_and_against_its_opposite(offset):
    zero = read(offset).by_signal[HEAD]
    assert zero.evidence(offset) == pytest.approx(0.5 * min((offset / HEALTHY_PA) ** 2, 25.0), rel=0.1)
    assert zero.evidence(-offset) <= 0.0 < zero.evidence(offset)


def test_a_right_zero_is_evidence_against_every_offset():
    zero = read(0.0).by_signal[HEAD]
    assert zero.evidence(2e5) < zero.evidence(0.5e5) < 0.0 == zero.evidence(0.0)


def test_a_chamber_that_still_holds_pressure_says_nothing_of_its_sensor():
    zeros = read(80e5)
    assert HEAD not in zeros.by_signal
    assert "stick_head_pressure reads 80.0 bar" in zeros.warnings[0]
    assert "relieve the lines" in zeros.warnings[0]


def test_only_pressures_have_zeros():
    names = {MACHINE.signals[k].name for k in read(0.0).by_signal}
    assert names == {s.name for s in MACHINE.signals if s.name.endswith("_pressure")}
