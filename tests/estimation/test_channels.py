"""From signals to motion on the rig: what a joint's cylinder says near its end stops is not believed."""

from array import array
from dataclasses import replace

import numpy as np
import pytest

from cylforce.estimation.channels import Channels
from cylforce.mechanics.installation import Filters
from cylforce.signals.kinds import Kind, Signal
from machines import excavator
from rig import readings, rig


def usable(low, high):
    """Whether the cylinder, 5 m long, is believed on a machine where it can be `low` to `high` [m] long."""
    machine = replace(rig(), cylinders=(replace(rig().cylinders[0], length_low=low, length_high=high),))
    return bool(Channels(machine, Filters(100.0, 5.0, 2.0, 2.0, 0.002)).run(readings(10)).usable[-1, 0])


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (4.0, 6.0, True),
        (4.994, 6.0, True),
        (4.996, 6.0, False),
        (4.0, 5.006, True),
        (4.0, 5.004, False),
    ],
)
def test_within_five_millimetres_of_an_end_stop_a_force_is_not_believed(low, high, expected):
    assert usable(low, high) is expected


def test_rates_have_the_sign_of_what_they_are_rates_of():
    """At 0.1 rad/s: the length is sqrt(25 + 24 sin a), its slope 12 cos a / length, about 2.4 m near the level."""
    t = np.arange(0.0, 1.0, 0.01)
    for way in (1.0, -1.0):
        moving = Channels(rig(), Filters(100.0, 5.0, 2.0, 2.0, 0.002)).run(readings(len(t), angle=0.1 * way * t))
        assert moving.motion.qd[-1, 0] == pytest.approx(0.1 * way, rel=1e-6)
        a = moving.motion.a[-1, 0]
        lever = 12.0 * np.cos(a) / np.sqrt(25.0 + 24.0 * np.sin(a))
        assert moving.motion.speed[-1, 0] == pytest.approx(0.1 * way * lever, rel=1e-6)


def test_a_measured_slew_rate_is_never_unwrapped_as_an_angle():
    """With both slew sensors the rate is the channel; steps of more than pi [rad/s] in it stay as they are."""
    machine = excavator()
    encoder = Signal("slew_encoder", Kind.SLEW_ANGLE, 0, -np.pi, np.pi, 0.01, 1e-3)
    both = replace(machine, signals=(*machine.signals, encoder))
    alone = replace(machine, signals=tuple(encoder if s.kind is Kind.SLEW_RATE else s for s in machine.signals))
    filters = Filters(100.0, 5.0, 2.0, 2.0, 0.002)
    at = [s.kind for s in machine.signals].index(Kind.SLEW_RATE)
    values = np.full((4, len(both.signals)), 0.1)
    values[:, at] = 0.0, 3.5, -1.0, 4.0
    rates = Channels(both, filters)
    assert rates.course(values)[:, -1].tolist() == values[:, at].tolist()
    before, now = rates.read(values[:2])
    assert rates.follow(before, array("d", now))[-1] == 3.5
    angles = Channels(alone, filters)
    assert angles.course(values[:, :-1])[:, -1] == pytest.approx(np.unwrap(values[:, at]))
    assert angles.follow(before, array("d", now))[-1] == pytest.approx(3.5 - 2.0 * np.pi)
