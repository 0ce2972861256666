"""Friction that turns round is no fault of a sensor: what is excused of leaps that are made up, and what is not."""

from array import array
from itertools import pairwise
from math import inf

import numpy as np
import pytest

from cylforce.estimation.model import Model, Tares
from cylforce.service.adaptation import DriftConstants, DriftFilter
from cylforce.service.core import Core
from cylforce.service.plausibility.detectors.pressure_step import PressureStep
from cylforce.service.plausibility.reversals import CLEAR, ReversalConstants, Reversals
from cylforce.service.plausibility.suspicion import Level, SensorFault, SensorSuspicion
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.kinds import Kind
from faulting.edits import BAR, place
from scenarios import EXCAVATOR, cycles, fed, identified, seconds, with_value

LOADED = load(EXCAVATOR)
MACHINE = LOADED.service.machine
STICK = 1
EXTENDS, RETRACTS = 1.0, -1.0
AFTER = 5  # steps between a leap and the reading at which it is doubted
DRY, ERROR, SHARE = 5000.0, 100.0, 0.02  # N, N, of the oil's force
LEVELS = np.array([120.0, 8.0, 60.0, 25.0, 15.0, 40.0]) * BAR


def friction(stribeck=0.0):
    """The stick's: 5 kN, 2 % of the oil's force, more in creeping; and a drift of which nothing was seen yet."""
    model = Model(MACHINE, LOADED.service.filters, ("coulomb", "load_dependent", "directional", "stribeck"))
    names = tuple(p.name for p in model.parameters)
    known = {"coulomb": DRY, "load_dependent": SHARE, "directional": 900.0, "stribeck": stribeck}
    values = np.array([known.get(name.removeprefix("stick."), 0.0) for name in names])
    spread = np.diag([ERROR**2 if name == "stick.coulomb" else 0.0 for name in names])
    tares = Tares(model.friction, names, values, spread, np.full(3, 20.0), True)
    constants = ReversalConstants(model, tares, AFTER)
    return Reversals.start(constants), DriftFilter.start(DriftConstants(model, tares))


def readings():
    """All signals, of which six are pressures."""
    pressures = iter(LEVELS)
    return np.array([next(pressures) if s.kind.endswith("_pressure") else 0.0 for s in MACHINE.signals])


def asked(newtons, side=Kind.HEAD_PRESSURE, way=EXTENDS, steps=100 + AFTER, stribeck=0.0, cylinder=STICK, speed=0.05):
    """Whether a step of one pressure that pushes the piston out by so many newtons may be friction."""
    own = MACHINE.cylinders[cylinder]
    area = own.area_head if side is Kind.HEAD_PRESSURE else -own.area_rod
    suspicion = SensorSuspicion(Level.SUSPECTED, SensorFault.STEPPED, (place(MACHINE, side, cylinder),), newtons / area)
    reversals, drift = friction(stribeck)
    reversals.at, reversals.way = array("d", [-inf, 100.0, -inf]), array("d", [0.0, way, 0.0])  # the stick's alone
    speeds = [0.1 if c != cylinder else speed for c in range(3)]
    return reversals.explains(suspicion, steps, speeds, readings(), drift)


def most(stribeck=0.0):
    """By hand: twice the friction at the stick's force of 60 and 25 bar, and three standard errors of it; of the
    drift, a twentieth of what was identified is expected, as between strokes of a real crane."""
    own = MACHINE.cylinders[STICK]
    force = abs(60e5 * own.area_head - 25e5 * own.area_rod)
    return 2.0 * (DRY + SHARE * force + stribeck + CLEAR * np.hypot(ERROR, 0.05 * DRY))


@pytest.mark.parametrize("side", [Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE])
@pytest.mark.parametrize("way", [EXTENDS, RETRACTS])
def test_no_more_than_twice_the_friction_turns_round(side, way):
    """What is larger one way than the other (`directional`) stays as it is."""
    assert asked(0.99 * way * most(), side, way)
    assert not asked(1.01 * way * most(), side, way)


def test_friction_is_against_the_motion():
    """A cylinder that begins to extend asks for more force outwards, never for less."""
    assert asked(DRY, way=EXTENDS)
    assert not asked(-DRY, way=EXTENDS)
    assert asked(-DRY, way=RETRACTS)


@pytest.mark.parametrize("stribeck", [800.0, -800.0])
def test_friction_of_creeping_may_be_as_much_more(stribeck):
    assert asked(0.99 * most(800.0), stribeck=stribeck)
    assert not asked(1.01 * most(800.0), stribeck=stribeck)


@pytest.mark.parametrize(("steps", "excused"), [(99, False), (100, True), (100 + AFTER, True), (101 + AFTER, False)])
def test_it_turns_round_in_the_moment_of_the_leap(steps, excused):
    assert asked(DRY, steps=steps) is excused


def test_at_rest_friction_may_change_either_way_at_any_time():
    slow = LOADED.service.filters.direction_speed
    for sign in (1.0, -1.0):
        assert asked(0.99 * sign * most(), steps=1000, speed=0.9 * slow)
        assert not asked(1.01 * sign * most(), steps=1000, speed=0.9 * slow)
        assert not asked(0.99 * sign * most(), steps=1000, speed=-1.1 * sign * slow)


def test_the_friction_of_another_cylinder_is_no_excuse():
    assert not asked(DRY, cylinder=0)


@pytest.fixture(scope="module")
def work():
    """The excavator's service, identified, events of a cycle; when [s] the stick turns round in the air, and which way,
    as the service sees it, a second or more after any other reversal of it."""
    core = Core(LOADED.service, identified(LOADED))
    events, _ = cycles(LOADED, count=1)
    state, turns = WeighingService.start(core), []
    for event in events:
        fed(state, event)
        reversals = state.monitor.detector(PressureStep).reversals
        if state.pipeline.state is not None and reversals.at[STICK] == state.pipeline.steps:
            turns.append((seconds(event), reversals.way[STICK]))
    alone = [b for a, b in pairwise(turns) if b[0] - a[0] > 1.0]
    return core, events, alone[0]


def doubted(core, events, begin, newtons):
    """What the service says 0.15 s after the stick's head pressure pushes out by so much more."""
    area = MACHINE.cylinders[STICK].area_head
    signal = MACHINE.signals[place(MACHINE, Kind.HEAD_PRESSURE, STICK)].name
    spoilt = with_value(events, core.service, signal, lambda _, v: v + newtons / area, begin)
    state, found = WeighingService.start(core), SensorFault.NONE
    for event in spoilt:
        if seconds(event) > begin + 0.15:
            break
        fed(state, event)
        found = max(found, state.monitor.suspicion.cause)
    return found


def test_the_service_knows_when_friction_turns_round(work):
    """A step of three times the dry friction, which in creeping is nearly twice as large, passes where the stick turns
    round, in the direction of its new motion; not against it, nor a second later, nor if it is five times as large."""
    core, events, (at, way) = work
    dry = way * core.tares.values[core.tares.names.index("stick.coulomb")]
    assert doubted(core, events, at, 3.0 * dry) is SensorFault.NONE
    assert doubted(core, events, at, -3.0 * dry) is SensorFault.STEPPED
    assert doubted(core, events, at + 1.0, 3.0 * dry) is SensorFault.STEPPED
    assert doubted(core, events, at, 5.0 * dry) is SensorFault.STEPPED
