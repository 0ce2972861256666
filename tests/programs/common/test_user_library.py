"""`--library FILE.py`: effects of the user's own are read, tried and simulated; a faulty file is refused in a sentence
with file, class and cure."""

from pathlib import Path

import numpy as np
import pytest

from cylforce.effects.fault import shapes
from cylforce.files.tables import read_table
from cylforce.programs.common.user_library import load_library
from cylforce.programs.sim import run_sim
from cylforce.settings.machine_file import SettingsError, load

EXCAVATOR = Path(__file__).resolve().parents[3] / "config/excavator_20t.toml"
MACHINE = load(EXCAVATOR).service.machine
HEAD = """from dataclasses import dataclass
import numpy as np
from cylforce.effects.fault import TORQUES, About, Place, ShapeRange, TimeCourse
"""
SQUEAK = '''
@dataclass(frozen=True)
class Squeak:
    """Friction that comes and goes with time."""

    period: float = 8.0
    sharp: float = 2.0

    @property
    def about(self):
        return About("squeak", "N", 100.0, 5e3, Place.CYLINDER, "now and then", "listen", 1)

    @property
    def shapes(self):
        return ShapeRange("period", 2.0, 30.0, log=True), ShapeRange("sharp", 1.0, 4.0)

    def force(self, speed, force, t):
        return np.tanh(speed / 0.002) * np.abs(np.sin(np.pi * t / self.period)) ** self.sharp
'''
PAIR = '''
@dataclass(frozen=True)
class Ripple:
    """A reading with a ripple of the angle."""

    across: bool = False

    @property
    def about(self):
        return About("ripple", "rad", 0.001, 0.05, Place.ANGLE, "with the angle", "look at the gear", axes=2)

    def distorted(self, machine, values, t, where, size):
        found = values.copy()
        angle = 10.0 * values[:, where]
        found[:, where] += size * (np.cos(angle) if self.across else np.sin(angle))
        return found


LIBRARY = ((Ripple(), Ripple(across=True)),)
'''

SHOVE = '''
@dataclass(frozen=True)
class Shove:
    """A torque at one joint, for some seconds."""

    columns = TORQUES
    course = TimeCourse.WINDOWS

    @property
    def about(self):
        return About("shove", "N m", 100.0, 1e5, Place.LINK, "now and then", "look")
'''


def written(tmp_path, *parts):
    path = tmp_path / "own.py"
    path.write_text("".join((HEAD, *parts)))
    return path


def test_every_class_is_an_effect_with_its_shapes(tmp_path):
    ((squeak,),) = load_library(written(tmp_path, SQUEAK), MACHINE)
    assert squeak.about.name == "squeak"
    assert [shape.field for shape in shapes((squeak,))] == ["period", "sharp"]
    assert hash(squeak) == hash(squeak)


def test_a_file_may_list_groups_of_several_sizes(tmp_path):
    (group,) = load_library(written(tmp_path, PAIR), MACHINE)
    assert [effect.across for effect in group] == [False, True]


def test_the_simulator_switches_the_users_effects_on(tmp_path):
    """A ripple of two sizes in one angle, and a squeak of two shape parameters in one cylinder."""
    library = written(tmp_path, SQUEAK, PAIR, "LIBRARY = (*LIBRARY, (Squeak(),))\n")
    effects, tables = tmp_path / "effects.toml", {}
    effects.write_text(
        '[[effects]]\nname = "ripple"\nat = "stick_angle"\nvalue = [0.01, 0.02]\n'
        '[[effects]]\nname = "squeak"\nat = "boom"\nvalue = 3000.0\nshape = {period = 5.0, sharp = 3.0}\n'
    )
    for name, given in {"plain": {}, "own": {"effects": effects, "library": library}}.items():
        path = tmp_path / f"{name}.csv"
        run_sim(EXCAVATOR, scenario="moves", duration=20.0, seed=7, table=path, **given)
        tables[name] = read_table(path, [s.name for s in MACHINE.signals])
    change = dict(
        zip([s.name for s in MACHINE.signals], (tables["own"].values - tables["plain"].values).T, strict=True)
    )
    angle = tables["plain"].values[:, [s.name for s in MACHINE.signals].index("stick_angle")]
    expected = 0.01 * np.sin(10 * angle) + 0.02 * np.cos(10 * angle)
    assert np.std(change["stick_angle"] - expected) < 1e-3  # the ripple of the sensor's own noise
    assert np.std(expected) > 5e-3
    assert np.max(np.abs(change["boom_head_pressure"])) > 1e5
    assert not np.any(change["bucket_angle"])


def test_without_the_library_the_name_is_unknown(tmp_path):
    effects = tmp_path / "effects.toml"
    effects.write_text('[[effects]]\nname = "squeak"\nat = "boom"\nvalue = 1000.0\n')
    with pytest.raises(SettingsError, match="effect 'squeak' is not known"):
        run_sim(EXCAVATOR, scenario="moves", duration=20.0, seed=7, effects=effects, table=tmp_path / "x.csv")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("class Squeak(:\n", r"own.py:4: is no Python"),
        ("\nimport not_there\n", r"own.py:5: fails \(ModuleNotFoundError: .*not_there.*\): correct it"),
        ("X = 1\n", r"holds no effect: give a Python file with effect classes"),
        ("LIBRARY = []\n", r"LIBRARY is no tuple of groups: write LIBRARY"),
        (SQUEAK.replace("(frozen=True)", ""), r"Squeak: is no frozen dataclass: write @dataclass\(frozen=True\)"),
        (SQUEAK.replace("period: float = 8.0", "period: float"), r"Squeak: its field period has no default: give it"),
        (SQUEAK.replace("def about", "def abut"), r"Squeak: has no `about`: add a property"),
        (SQUEAK.replace('return About("squeak"', 'return ("squeak"'), r"Squeak: its `about` is \('squeak'.*: make it"),
        (SQUEAK.replace('About("squeak", "N"', 'About("squeak", ""'), r"Squeak: `unit` of its About is ''"),
        (SQUEAK.replace('"squeak"', '"stribeck"'), r"'stribeck', which another effect is: choose another name"),
        (SQUEAK.replace("100.0, 5e3", "5e3, 100.0"), r"plausible range is 5000.0 to 100.0: give numbers with 0 < low"),
        (SQUEAK.replace("Place.CYLINDER", '"boom"'), r"its place is 'boom': choose one of Place.CYLINDER"),
        (SQUEAK.replace("def force", "def push"), r"Squeak: does nothing: give it one of the methods force\(speed"),
        (
            SQUEAK.replace("speed, force, t)", "t, speed)"),
            r"is force\(t, speed\): write force\(self, speed, force, t\)",
        ),
        (SQUEAK.replace('"period", 2.0', '"time", 2.0'), r"its shape 'time' is None: make it a field"),
        (SQUEAK.replace("2.0, 30.0", "20.0, 30.0"), r"its shape 'period' is 8: start within its range 20 to 30"),
        (SQUEAK.replace("2.0, 30.0", "0.0, 30.0"), r"'period' is logarithmic and begins at zero: give it a shift"),
        (SQUEAK.replace("np.tanh(speed / 0.002)", "np.log(-np.abs(speed))"), r"not finite at boom on a test motion"),
        (SQUEAK.replace("self.sharp\n", "self.sharp[0]\n"), r"fails at boom on a test motion \(TypeError"),
        (SQUEAK.replace("return np.tanh", "return np.ones(3) + 0 * np.tanh(1.0) #"), r"shape \(3,\) at boom: make it"),
        (SHOVE, r"Shove: changes the columns \('torque.0'.*: choose among "),
        (PAIR.replace("values.copy()", "values"), r"Ripple: .*it changes the values that it is given"),
    ],
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_faulty_file_is_refused_with_class_and_cure(tmp_path, text, said):
    with pytest.raises(SettingsError, match=said) as refused:
        load_library(written(tmp_path, text), MACHINE)
    assert str(refused.value).startswith(f"{tmp_path}/own.py:")


@pytest.mark.parametrize("name", ["none.py", "own.txt"])
def test_a_file_that_is_not_there_or_no_python_is_refused(tmp_path, name):
    (tmp_path / "own.txt").write_text("squeak")
    with pytest.raises(SettingsError, match=r"give a Python file with effect classes"):
        load_library(tmp_path / name)
