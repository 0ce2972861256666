"""Local gravity: against tables of geodesy and measured values, and what it does to a weight."""

from dataclasses import replace

import pytest

from cylforce.mechanics.gravity import normal_gravity
from cylforce.service.core import Core
from cylforce.settings.machine_file import SettingsError, load
from cylforce.signals.units import DEGREE
from held_arm import SERVICE, estimates, readings, tares
from scenarios import EXCAVATOR

LOAD, QUITO = 800.0, 9.7724
SHIPPED = EXCAVATOR.read_text()
RATED = "rated_payload_kg = 1500"


@pytest.mark.parametrize(
    ("latitude_deg", "g"), [(0.0, 9.7803253359), (45.0, 9.806197769), (-45.0, 9.806197769), (90.0, 9.8321849378)]
)
def test_normal_gravity_on_the_ellipsoid_as_tabulated(latitude_deg, g):
    """WGS 84, NIMA TR8350.2, table 3.4, and the value at 45 degrees from its Somigliana formula."""
    assert normal_gravity(latitude_deg * DEGREE) == pytest.approx(g, abs=1e-8)


@pytest.mark.parametrize(
    ("place", "latitude_deg", "height", "g"),
    [("Potsdam", 52.3806, 87.0, 9.81260), ("Denver", 39.74, 1609.0, 9.796), ("Quito", -0.22, 2850.0, 9.7724)],
)
def test_gravity_as_measured(place, latitude_deg, height, g):
    """The rest, anomalies of the ground, is below a kilogram in five tonnes."""
    assert normal_gravity(latitude_deg * DEGREE, height) == pytest.approx(g, rel=2e-4), place


def changed(tmp_path, keys):
    path = tmp_path / "machine.toml"
    path.write_text(SHIPPED.replace(RATED, f"{RATED}\n{keys}"))
    return path


def test_the_machine_has_the_gravity_of_its_place(tmp_path):
    machine = load(changed(tmp_path, "latitude_deg = 52.38\nheight_m = 87")).service.machine
    assert machine.gravity == pytest.approx(9.8126, rel=2e-5)
    assert load(changed(tmp_path, "gravity_m_s2 = 9.7724")).service.machine.gravity == 9.7724
    assert load(EXCAVATOR).service.machine.gravity == 9.80665


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("gravity_m_s2 = -9.81", "machine.gravity_m_s2"),
        ("gravity_m_s2 = 0.0", "machine.gravity_m_s2"),
        ("latitude_deg = 91.0", "machine.latitude_deg"),
        ("height_m = 300.0", "machine.height_m.*add latitude_deg"),
        ("gravity_m_s2 = 9.81\nlatitude_deg = 48.0", "machine.gravity_m_s2.*keep gravity_m_s2 if it was measured"),
    ],
)
def test_what_cannot_be_is_refused_with_its_key(tmp_path, keys, words):
    with pytest.raises(SettingsError, match=words):
        load(changed(tmp_path, keys))


@pytest.mark.parametrize(("known", "right"), [(QUITO, True), (9.80665, False)])
def test_a_load_in_quito_weighs_what_it_is_only_if_the_machine_knows_where_it_is(known, right):
    """Pressures of hand statics with the gravity of Quito; without it arm and load both seem 0.35 % lighter."""
    service = SERVICE._replace(machine=replace(SERVICE.machine, gravity=known))
    last = estimates(Core(service, tares()), lambda _: readings(held=(LOAD, 0.7, 0.1), g=QUITO), 6.0)[-1]
    assert last.force.z.value == pytest.approx(-LOAD * QUITO, rel=0.02)
    assert (abs(last.load.mass.value - LOAD) < 1.0) == right
