"""The bars of a linkage weigh and resist as hand mechanics say (virtual work of a mass at the rocker's end, from the
pins of the machine file), and what the machine file tells of them is taken out of the links."""

import numpy as np
import pytest

from chains import chain, machine
from cylforce.effects.loads.rigid import Rigid
from cylforce.effects.loads.rocker_weight import RockerWeight
from cylforce.effects.loads.slew import Slew
from cylforce.estimation.model import Model
from cylforce.estimation.priors.bars import BAR, ERROR, STEEL, balanced, guess, represented
from cylforce.mechanics.motion import Attitude, motion
from cylforce.settings.machine_file import load
from machines import excavator, stick_and_bucket
from rocker import ATTITUDES, DT, MIDDLE, MOMENT, NAMES, ROCKER, ends, moved
from scenarios import CONFIG, EXCAVATOR
from statics import FILE, G, H


def torques(t, attitude):
    """Of the bars, by virtual work: (acceleration of each mass, and gravity) . (slope of its place)."""
    steps = H * np.eye(3)
    slopes = np.array([(ends(moved(t) + s) - ends(moved(t) - s)) / (2 * H) for s in steps])
    speeding = (ends(moved(t + 1e-3)) - 2 * ends(moved(t)) + ends(moved(t - 1e-3))) / 1e-6
    up = G * np.cos(attitude.roll) * np.array([np.sin(attitude.pitch), np.cos(attitude.pitch)])
    rho = FILE["machine"]["slew_axis_m"] + ends(moved(t))[:, 0]
    thrown = np.stack([attitude.slew**2 * rho, 0.0 * rho], axis=-1)
    kilograms = MOMENT / ROCKER["rocker_m"] * np.array([1.0, -1.0])
    return np.einsum("jpx,px,p->j", slopes, speeding + up - thrown, kilograms)


@pytest.mark.parametrize("attitude", ATTITUDES, ids=NAMES)
@pytest.mark.parametrize("t", [0.3, 1.1, 2.0, 2.9])
def test_its_torques_are_those_of_a_mass_at_the_rockers_end(t, attitude):
    which = load(EXCAVATOR).service.machine
    times = t + DT * np.arange(-1, 2)
    theta = np.array([moved(x) for x in times])
    thetad = np.array([(moved(x + DT) - moved(x - DT)) / (2 * DT) for x in times])
    found = RockerWeight().halves(which, motion(which, theta, thetad, np.zeros((3, 3)), attitude))
    rising = (found.momentum[2] - found.momentum[0]) / (2 * DT)
    np.testing.assert_allclose(MOMENT * (rising + found.static[1])[:, 0], torques(t, attitude), rtol=1e-4, atol=0.05)


@pytest.mark.parametrize("which", [excavator(), stick_and_bucket()], ids=lambda m: m.name)
def test_a_rocker_that_stands_still_to_its_link_is_a_part_of_the_link(which):
    """While the bucket keeps its angle to the stick nothing tells the bars from the stick, at any speed, on any slope:
    a recording cannot."""
    rng, n = np.random.default_rng(1), which.size
    theta, thetad = MIDDLE[-n:] + rng.uniform(-0.4, 0.4, (300, n)), rng.normal(size=(300, n))
    theta[:, -1], thetad[:, -1] = MIDDLE[-1], 0.0
    attitude = Attitude(rng.uniform(-0.1, 0.1, 300), 0.05, 0.0, rng.uniform(-1.0, 1.0, 300))
    moving = motion(which, theta, thetad, np.zeros((300, len(which.cylinders))), attitude)
    both, kinds = [], (RockerWeight(), Rigid(), Slew())
    for effect in kinds:
        found = effect.halves(which, moving)
        momentum = np.zeros_like(found.static) if found.momentum is None else found.momentum
        both.append(np.stack([momentum, found.static])[:, :, :-1])  # the bucket's own row is at rest: unused
    named = [
        dict(zip(e.parameters(which), np.moveaxis(c, -1, 0), strict=True)) for e, c in zip(kinds, both, strict=True)
    ]
    links, slew = named[1:]
    wanted = both[0].ravel()
    known = np.array([links.get(p, 0.0) + column for p, column in slew.items()]).reshape(len(slew), -1).T
    left = wanted - known @ np.linalg.lstsq(known, wanted, rcond=None)[0]
    assert np.abs(left).max() < 1e-9 * np.abs(wanted).max()


def test_where_a_linkage_cannot_be_closed_there_is_none():
    which = excavator()
    theta = np.linspace(-4.0, 4.0, 200)[:, None] * np.array([0.0, 0.0, 1.0]) + MIDDLE * np.array([1.0, 1.0, 0.0])
    found = RockerWeight().halves(which, motion(which, theta, 0.0 * theta, np.zeros((200, 3))))
    assert np.all(np.isfinite(found.static))
    assert np.any(np.all(found.static == 0.0, axis=1))


def test_a_machine_without_four_bars_has_none():
    assert RockerWeight().parameters(machine(chain(np.random.default_rng(0), 2))) == ()
    assert [p.name for p in RockerWeight().parameters(excavator())] == ["bucket.rocker"]


# --- what the machine file tells --------------------------------------------------------------------------------------


def test_bars_are_of_steel_and_as_long_as_in_the_machine_file():
    """By hand: a rocker of 0.68 m and half a link of 0.66 m, 0.1 m square; half of a rod of 80 mm and 1.75 m."""
    cylinder = load(EXCAVATOR).service.machine.cylinders[2]
    bar, rod = STEEL * BAR**2, STEEL * np.pi / 4 * 0.08**2 * 1.75
    by_hand = bar * 0.68 * 0.34 + (bar * 0.66 / 2 + rod / 2) * 0.68
    assert guess(cylinder, cylinder.linkage) == pytest.approx((by_hand, ERROR * by_hand))


@pytest.mark.parametrize("name", ["excavator_20t.toml", "excavator_stick_bucket.toml", "wheel_loader.toml"])
def test_the_data_sheet_is_known_as_well_as_without_bars(name):
    """The links of a data sheet contain the bars: links and bars together are what it says, to what it says."""
    service = load(CONFIG / name).service
    whole, without = (Model(service.machine, service.filters, laws) for laws in (("coulomb", "rocker"), ("coulomb",)))
    names = tuple(p.name for p in whole.parameters)
    sums = represented(service.machine, names)
    kept = [k for k, n in enumerate(names) if not n.endswith((".rocker", ".cylinder"))]
    np.testing.assert_allclose((sums @ whole.prior.mean)[kept], without.prior.mean, atol=1e-6)
    covariance = (sums @ whole.prior.covariance @ sums.T)[np.ix_(kept, kept)]
    np.testing.assert_allclose(covariance, without.prior.covariance, atol=1e-3)


def test_bars_on_both_sides_of_the_pin_may_have_either_sign():
    loader, digger = (load(CONFIG / n).service.machine for n in ("wheel_loader.toml", "excavator_20t.toml"))
    assert balanced(loader) == {"tilt.rocker"}
    assert balanced(digger) == set()
