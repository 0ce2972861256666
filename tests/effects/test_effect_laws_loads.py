"""Laws of loads: weight, inertia, centrifugal force and force at the teeth, each pinned to numbers worked out by hand;
and that no effect is left without such a number."""

from math import cos, radians, sin
from pathlib import Path

import numpy as np
import pytest

import cylforce.effects
from cylforce.effects.imposed import Imposed, changed_load, contact_force
from cylforce.effects.incidents.payload_shift import PayloadShift
from cylforce.effects.incidents.payload_spill import PayloadSpill
from cylforce.effects.loads.carried import CarriedLoad, smooth
from cylforce.effects.loads.cylinder_weight import CylinderWeight
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.loads.first_moment_change import FirstMomentChange
from cylforce.effects.loads.hose_spring import HoseSpring
from cylforce.effects.loads.mud import Mud
from cylforce.effects.loads.rigid import Rigid
from cylforce.effects.loads.rocker_weight import RockerWeight
from cylforce.effects.loads.slew import Slew, slew_parameters
from cylforce.effects.loads.tip_force import TipForce, tip_torque
from cylforce.mechanics.linkages import FourBar, Triangle
from cylforce.mechanics.machine import Cylinder, Link, Machine, base_parameters
from cylforce.mechanics.motion import Attitude, motion

G = 9.80665  # m/s^2
L1 = 5.0  # m, pin to pin of the inner link
INNER = Link("inner", L1, 0.0, 0.0, 0.0, 0.0, -3.0, 3.0, 0.0, 0.0, 0.0)


def arm(*links, tool=1.0 + 0j, slew_axis=0.0):
    """A chain without cylinders."""
    return Machine("arm", links, (), (), tool, 1000.0, 1.0, slew_axis)


def outer(mass=0.0, cx=0.0, cz=0.0):
    """The link beyond, a mass at a point."""
    return Link("outer", 3.0, mass, cx, cz, 0.0, -3.0, 3.0, 0.0, 0.0, 0.0)


def at(machine, a, rates=None, **attitude):
    """Motion with links at a [rad] from the chassis, turning at absolute rates [rad/s]."""
    theta = np.diff(a, prepend=0.0)
    joint_rates = np.diff(np.zeros(len(a)) if rates is None else rates, prepend=0.0)
    return motion(machine, theta, joint_rates, np.zeros(len(machine.cylinders)), Attitude(**attitude))


def test_a_weight_asks_for_its_horizontal_arm():
    """500 kg 2 m out: level 9806.65 N m, at 60 degrees half of it, on a slope of 60 degrees as well; above the pin
    nothing; rolled by 60 degrees half."""
    one = arm(Link("one", 3.0, 500.0, 2.0, 0.0, 0.0, -3, 3, 0, 0, 0))
    for a, attitude, expected in [
        (0.0, {}, 9806.65),
        (radians(60), {}, 4903.325),
        (0.0, {"pitch": radians(60)}, 4903.325),
        (radians(90), {}, 0.0),
        (0.0, {"roll": radians(60)}, 4903.325),
    ]:
        found = Rigid().halves(one, at(one, [a], **attitude)).static @ base_parameters(one.links)
        assert found[0] == pytest.approx(expected, abs=1e-9)


def test_a_mass_on_a_link_asks_for_its_arm_at_this_joint_and_all_before():
    """300 kg at (1.2, 0.4) of a link at -30 degrees, on one of 5 m at 40 degrees; besides 60 kg m along it."""
    machine = arm(INNER, outer(800.0, 1.2, 0.4))
    a = np.radians([40.0, -30.0])
    columns = Rigid().halves(machine, at(machine, a)).static @ ExtraMass().change(machine, 1)
    here = G * (300.0 * (1.2 * cos(a[1]) - 0.4 * sin(a[1])) + 60.0 * cos(a[1]))
    before = 300.0 * G * L1 * cos(a[0])
    np.testing.assert_allclose(columns @ [300.0, 60.0, 0.0, 50.0], [here + before, here])


def test_a_mass_on_a_link_has_the_inertia_of_its_distances():
    """All turn as one, links in line and level: 300 kg at 5 m + (1.2, 0.4), and 50 kg m^2 of its own."""
    machine = arm(INNER, outer(800.0, 1.2, 0.4))
    momentum = Rigid().halves(machine, at(machine, [0.0, 0.0], [1.0, 1.0])).momentum @ ExtraMass().change(machine, 1)
    about_outer = [300.0 * (1.2 * 6.2 + 0.4 * 0.4) + 50.0]
    about_inner = [300.0 * (6.2**2 + 0.4**2) + 50.0]
    np.testing.assert_allclose(momentum @ [300.0, 0.0, 0.0, 50.0], about_inner + about_outer)


def test_a_first_moment_loads_the_level_link_along_it_and_the_upright_one_across():
    """100 kg m: 980.665 N m at this joint and the one before; across (towards the sky of a level link) an upright link
    is pulled over backwards."""
    machine = arm(INNER, outer())
    for a, sizes, expected in [(0.0, [100.0, 0, 0], 980.665), (radians(90), [0, 100.0, 0], -980.665)]:
        columns = Rigid().halves(machine, at(machine, [0.3, a])).static @ FirstMomentChange().change(machine, 1)
        np.testing.assert_allclose(columns @ sizes, [expected, expected])
    momentum = Rigid().halves(machine, at(machine, [0.3, 0.0], [0.0, 2.0])).momentum
    np.testing.assert_allclose(momentum @ FirstMomentChange().change(machine, 1) @ [0, 0, 30.0], [60.0, 60.0])


def test_the_rocker_of_a_parallelogram_weighs_as_if_it_hung_on_the_link():
    """60 kg m at 60 degrees: 60 g cos 60 = 294.2 N m."""
    bars = FourBar((0, -1 + 1j), (0, 0 + 1j), (1, 0.5 + 0j), 0.5, 1.0, 1)
    cylinder = Cylinder("lift", bars, 0.01, 0.006, 0.0, 9.0)
    machine = Machine("one", (outer(),), (cylinder,), (), 1 + 0j, 1000.0, 1.0, 0.0)
    found = RockerWeight().halves(machine, at(machine, [radians(60)])).static
    assert 60.0 * found[0, 0] == pytest.approx(294.1995)


def test_the_barrel_of_a_cylinder_weighs_along_its_line_and_turns_with_it():
    """From (2, 0) on the inner link to (0, 4) on the level outer one, whose pin is at (5, 0): 5 m along (0.6, 0.8). A
    radian of the outer joint moves the eye by (-4, 0), 3.2 m across the line, and turns it by 0.64. 100 kg m weigh
    100 g 0.6 about the inner pin, 0.64 of it about the outer. A mass w/s at s = 1.5 m less the same at the foot resists
    the inner joint with w (2 * 2 * 0.6 + s), and the outer with w 0.64 (2 * 0.6 + s); the outer's own rate, about
    the foot, with w 0.64^2 s."""
    cylinder = Cylinder("outer", Triangle((1, 2 + 0j), (2, 4j)), 0.01, 0.006, 3.0, 9.0)
    machine = Machine("two", (INNER, outer()), (cylinder,), (), 1 + 0j, 1000.0, 1.0, 0.0)
    found = CylinderWeight().halves(machine, at(machine, [0.0, 0.0]))
    np.testing.assert_allclose(100.0 * found.static[:, 0], 60.0 * G * np.array([1.0, 0.64]))
    inner = CylinderWeight().halves(machine, at(machine, [0.0, 0.0], [1.0, 1.0]))
    np.testing.assert_allclose(100.0 * inner.momentum[:, 0], 100.0 * np.array([2.4 + 1.5, 0.64 * (1.2 + 1.5)]))
    own = CylinderWeight().halves(machine, at(machine, [0.0, 0.0], [0.0, 1.0]))
    assert 100.0 * own.momentum[1, 0] == pytest.approx(100.0 * 0.64**2 * 1.5)


def test_a_cylinder_on_the_chassis_has_no_weight_of_its_own():
    cylinder = Cylinder("inner", Triangle((0, 2 + 0j), (1, 4j)), 0.01, 0.006, 3.0, 9.0)
    machine = Machine("two", (INNER, outer()), (cylinder,), (), 1 + 0j, 1000.0, 1.0, 0.0)
    assert CylinderWeight().parameters(machine) == ()


def centrifugal(machine, a, rate):
    """Torques (N,) of a turning house, (J, X, Z, D_excess, E) of the links from their data sheet."""
    values = np.hstack([base_parameters(machine.links).reshape(-1, 3), slew_parameters(machine.links)])
    return Slew().halves(machine, at(machine, a, slew=rate)).static @ values.reshape(-1)


def test_a_turning_house_throws_a_mass_outwards():
    """1000 kg, 2 m out at 30 degrees: 1 m above a pin that is 0.3 m before the axis, 2.032 m from the axis. At
    0.5 rad/s m w^2 rho z = 508.01 N m are needed to hold it, either way round."""
    machine = arm(outer(1000.0, 2.0), slew_axis=0.3)
    for rate in (0.5, -0.5):
        assert centrifugal(machine, [radians(30)], rate)[0] == pytest.approx(508.0127)
    assert centrifugal(machine, [radians(-30)], 0.5)[0] == pytest.approx(-508.0127)


def test_a_mass_aside_of_its_link_on_another_is_thrown_outwards_too():
    """About both pins: m w^2 times its distance from the axis times its height above the pin."""
    mass, rate, (cx, cz), a = 700.0, 0.4, (1.1, 0.5), np.radians([35.0, -50.0])
    machine = arm(INNER, outer(mass, cx, cz), slew_axis=0.3)
    own = np.array([cx * cos(a[1]) - cz * sin(a[1]), cx * sin(a[1]) + cz * cos(a[1])])
    inner = L1 * np.array([cos(a[0]), sin(a[0])])
    pull = mass * rate**2 * (0.3 + inner[0] + own[0])
    np.testing.assert_allclose(centrifugal(machine, a, rate), [pull * (inner[1] + own[1]), pull * own[1]])


def test_a_force_at_the_teeth_asks_for_virtual_work():
    """Tool 5 m + 1 m out, level, on a slope of 30 degrees. Pushed up by 1 kN the joints need less than nothing: minus
    their horizontal distance; pushed forward by 1 kN, their height under it. A moment counts once at every joint."""
    machine = arm(INNER, outer(), tool=1.0 + 0j)
    moving = at(machine, [0.0, 0.0], pitch=radians(30))
    away, height = np.array([6.0, 1.0]) * cos(radians(30)), np.array([6.0, 1.0]) * 0.5
    np.testing.assert_allclose(tip_torque(machine, moving, np.array([0.0, 1000.0])), -1000.0 * away)
    np.testing.assert_allclose(tip_torque(machine, moving, np.array([1000.0, 0.0])), 1000.0 * height)
    np.testing.assert_allclose(TipForce().halves(machine, moving).static[:, 2], [-1.0, -1.0])


def test_the_teeth_enter_the_soil_within_a_third_of_a_second():
    """Half of the force after half of 0.35 s, all of it afterwards, and out again as fast."""
    t = np.array([10.0, 10.175, 10.35, 12.0, 13.825, 14.0])
    found = contact_force([Imposed((TipForce(),), "outer", 1, (2e3, 5e3), 10.0, 14.0)], t)
    np.testing.assert_allclose(found, np.outer([0.0, 0.5, 1.0, 1.0, 0.5, 0.0], [2e3, 5e3]), atol=1e-9)


def test_what_comes_smoothly_does_so_without_a_jerk():
    """10 u^3 - 15 u^4 + 6 u^5 at a quarter: 0.15625 - 0.05859375 + 0.005859375."""
    np.testing.assert_allclose(smooth(np.array([1.0, 2.0, 3.0, 5.0, 9.0]), 1.0, 5.0), [0, 0.103515625, 0.5, 1, 1])


def load(seconds=3):
    """800 kg at (0.7, 0.1) with 400 kg m^2."""
    return CarriedLoad(np.full(seconds, 800.0), np.tile([0.7, 0.1], (seconds, 1)), np.full(seconds, 400.0))


def test_what_spills_takes_its_mass_and_its_moments():
    """300 kg from 0.1 m behind the centre leave 500 kg with their centre 0.06 m farther out; inertia is in
    proportion to mass."""
    sizes = (-300.0, -300.0 * 0.6, -300.0 * 0.1)
    found = changed_load([Imposed((PayloadSpill(),), "outer", 1, sizes, 1.0)], load(), np.arange(3.0))
    np.testing.assert_allclose(found.mass, [800.0, 500.0, 500.0])
    np.testing.assert_allclose(found.centre, [[0.7, 0.1], [0.76, 0.1], [0.76, 0.1]])
    np.testing.assert_allclose(found.inertia, [400.0, 250.0, 250.0])


def test_what_spills_at_work_is_gone_until_the_bucket_is_emptied():
    """200 of 800 kg fall out at second 2. While the bucket empties, a quarter of what is still there is missing; the
    next load of 900 kg is whole, in this scene and in a later one, which begins with an empty bucket."""
    mass = np.array([0.0, 800.0, 800.0, 800.0, 400.0, 0.0, 0.0, 900.0])
    carried = CarriedLoad(mass, np.tile([0.7, 0.1], (8, 1)), 0.5 * mass)
    spill = [Imposed((PayloadSpill(),), "outer", 1, (-200.0, -140.0, -20.0), 2.0)]
    found = changed_load(spill, carried, np.arange(8.0))
    np.testing.assert_allclose(found.mass, [0.0, 800.0, 600.0, 600.0, 300.0, 0.0, 0.0, 900.0])
    np.testing.assert_allclose(found.centre[mass > 0.0], np.tile([0.7, 0.1], (6 - 1, 1)))
    np.testing.assert_allclose(changed_load(spill, carried, 100.0 + np.arange(8.0)).mass, mass)
    still = CarriedLoad(mass[1:4], np.tile([0.7, 0.1], (3, 1)), mass[1:4])
    np.testing.assert_allclose(changed_load(spill, still, 100.0 + np.arange(3.0)).mass, 600.0)


def test_a_load_that_shifts_keeps_its_mass_and_moves_its_centre():
    """120 kg m along and 40 across, of 800 kg: 0.15 m and 0.05 m."""
    found = changed_load([Imposed((PayloadShift(),), "outer", 1, (120.0, 40.0), 1.0)], load(), np.arange(3.0))
    np.testing.assert_allclose(found.mass, 800.0)
    np.testing.assert_allclose(found.centre, [[0.7, 0.1], [0.85, 0.15], [0.85, 0.15]])


def test_mud_is_a_mass_that_grows():
    """Off the centre by d its moments are m d; evenly grown it is half there after five of ten minutes, and where it
    fills up within 200 s (1 - e^-1.5) / (1 - e^-3) of it."""
    machine = arm(INNER, outer(800.0, 1.2, 0.4))
    moved = arm(INNER, outer(100.0, 1.3, 0.2))
    bare = arm(INNER, outer(0.0, 1.3, 0.2))
    change = Mud().change(machine, 1) @ np.array([100.0, 10.0, -20.0])
    expected = base_parameters(moved.links) - base_parameters(bare.links)
    expected[3] += -100.0 * (0.1**2 + 0.2**2)  # of second order in the distance
    np.testing.assert_allclose(change, expected, atol=1e-9)
    t = np.array([0.0, 300.0, 600.0])
    np.testing.assert_allclose(Mud().grown(t), [0.0, 0.5, 1.0])
    np.testing.assert_allclose(Mud(1.0 / 200.0).grown(t), [0.0, 0.8175745, 1.0], rtol=1e-6)


def test_hoses_pull_the_joint_back_to_where_they_are_at_rest():
    """500 N m/rad; the joint's range is -3 to 3: at 0.6 rad 300 N m, from the low end 1800 N m; cubic
    500 * 0.6 * (0.6 / 3)^2 = 12 N m. The joint's own angle counts, not the link's."""
    machine = arm(INNER, outer())
    moving, t = at(machine, np.array([[0.5, 1.1]]), np.zeros((1, 2))), np.zeros(1)
    for effect, expected in [
        (HoseSpring(), 300.0),
        (HoseSpring(rest=0.0), 1800.0),
        (HoseSpring(rest=1.0), -1200.0),
        (HoseSpring(cubic=True), 12.0),
    ]:
        np.testing.assert_allclose(500.0 * effect.torque(machine, moving, t, 1), [[0.0, expected]])


def test_every_effect_has_its_number():
    """Each file of each kind of effect is imported by one of these files."""
    tests = "".join(path.read_text() for path in Path(__file__).parent.glob("test_effect_laws_*.py"))
    files = Path(cylforce.effects.__file__).parent.glob("*/*.py")
    names = [f"cylforce.effects.{f.parent.name}.{f.stem} import" for f in files if f.stem != "__init__"]
    assert len(names) > 25
    assert [name for name in names if name not in tests] == []
