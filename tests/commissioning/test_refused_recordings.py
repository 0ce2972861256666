"""A recording of another machine than the empty, free, well-wired one is refused, with a sentence that says why; that
of the right one is not. Each kind of mistake always runs on one machine, on others it is `long`. (Twenty machines each:
tools/accuracy.)"""

from functools import cache

import numpy as np
import pytest

from cylforce.commissioning.identification import identify
from cylforce.programs.common.readings import model_of
from cylforce.settings.machine_file import load
from scenarios import CONFIG, EXCAVATOR, SMALL
from spoilt import exchanged, samples, touching, with_bore

SEEDS = range(60, 64)
MACHINES = sorted(CONFIG.glob("excavator*.toml"))
LOADED = load(EXCAVATOR)
MODEL = model_of(LOADED)
FEW = load(SMALL)
FEW_MODEL = model_of(FEW)


def on_all(machines, kinds, always=None):
    """Every kind of mistake on every machine: `long` but for the k-th kind on the k-th machine, of the first `always`
    kinds (None: all)."""
    pairs = [(k, j, (machine, *kind)) for k, machine in enumerate(machines) for j, kind in enumerate(kinds)]
    return [
        pytest.param(
            *each,
            marks=[] if k == j % len(machines) and (always is None or j < always) else pytest.mark.long,
            id="-".join(str(getattr(part, "stem", part)) for part in each),
        )
        for k, j, each in pairs
    ]


@cache
def empty(loaded):
    """Moves of one good machine."""
    return samples(loaded, 60)


def names_of(model):
    return [s.name for s in model.machine.signals]


@pytest.mark.parametrize("machine", MACHINES, ids=lambda path: path.stem)
@pytest.mark.parametrize("seed", SEEDS)
def test_an_empty_machine_is_not_refused(machine, seed):
    loaded = load(machine)
    found = identify(model_of(loaded), [samples(loaded, seed)])
    assert np.all(np.isfinite(found.tares.values))


@pytest.mark.parametrize(
    ("machine", "seed", "kg"), on_all(MACHINES[::-1], [(60, 300.0), (61, 500.0), (62, 900.0), (63, 1500.0)], 1)
)
def test_a_load_is_refused(machine, seed, kg):
    loaded = load(machine)
    with pytest.raises(ValueError, match=r"the bucket is not empty: about \d+ \+- \d+ kg hang on the machine"):
        identify(model_of(loaded), [samples(loaded, seed, kg)])


@pytest.mark.parametrize(("seed", "share", "newtons"), on_all(SEEDS, [(0.1, 3e3), (0.05, 30e3), (0.3, 30e3)], 1))
def test_a_tool_on_the_ground_is_refused(seed, share, newtons):
    with pytest.raises(ValueError, match=r"for about \d+ s something (pressed|acted)"):
        identify(MODEL, [samples(LOADED, seed, effects=touching(share, newtons))])


@pytest.mark.parametrize(("factor", "c"), on_all([1.04, 0.96], [(0,), (1,), (2,)], 1))
def test_a_wrong_bore_is_refused(c, factor):
    name = MODEL.machine.cylinders[c].name
    with pytest.raises(ValueError, match=f"the forces of {name} are .* check bore_mm and rod_mm of {name}"):
        identify(with_bore(MODEL, c, factor), [empty(LOADED)])


@pytest.mark.parametrize(
    ("machine", "first", "second"),
    [
        (SMALL, ["stick_head_pressure"], ["stick_rod_pressure"]),
        (SMALL, ["stick_head_pressure", "stick_rod_pressure"], ["bucket_head_pressure", "bucket_rod_pressure"]),
        *on_all(
            [EXCAVATOR],
            [
                (["boom_head_pressure"], ["boom_rod_pressure"]),
                (["bucket_head_pressure"], ["bucket_rod_pressure"]),
                (["stick_angle"], ["bucket_angle"]),
                (["boom_angle"], ["stick_angle"]),
                (["stick_head_pressure", "stick_rod_pressure"], ["bucket_head_pressure", "bucket_rod_pressure"]),
            ],
            0,
        ),
    ],
)
def test_exchanged_sensors_are_named(machine, first, second):
    loaded = load(machine)
    model = model_of(loaded)
    signals = names_of(model)
    values = exchanged(empty(loaded), *([signals.index(name) for name in part] for part in (first, second)))
    sentence = f"{' and '.join(first)} must change places with {' and '.join(second)}"
    with pytest.raises(ValueError, match=sentence):
        identify(model, [values])


@pytest.mark.parametrize(
    "name", [n for n in names_of(MODEL) if n.endswith(("head_pressure", "rod_pressure", "_angle"))]
)
def test_a_frozen_sensor_is_named(name):
    values, k = empty(LOADED).copy(), names_of(MODEL).index(name)
    values[len(values) // 2 :, k] = values[len(values) // 2, k]
    with pytest.raises(ValueError, match=rf"{name} .*the sensor is frozen"):
        identify(MODEL, [values])


def test_whoever_knows_better_is_believed():
    found = identify(FEW_MODEL, [samples(FEW, 61, 500.0)], refuse=False)
    assert np.isfinite(found.tares.values).all()
