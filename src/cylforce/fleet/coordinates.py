"""What is followed over a machine's recordings: the parameters of its model, the zeros of its pressure sensors, and the
offsets of its angle sensors."""

from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.constants import CREEP_CHANGE, VARYING_CHANGE
from cylforce.diagnosis.model import CREEP
from cylforce.effects.friction.friction_level_change import FrictionLevelChange
from cylforce.effects.friction.load_dependent_friction import LoadDependentFriction
from cylforce.effects.friction.stribeck import Stribeck
from cylforce.effects.library import Proposal, proposals
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.loads.first_moment_change import FirstMomentChange
from cylforce.effects.sensors.angle_offset import AngleOffset
from cylforce.effects.sensors.delay import Delay
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.estimation.model import EXPECTED, FRICTION, Model
from cylforce.mechanics.installation import Service
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import Kind

DIRECTIONAL = "directional"  # friction that looks like a pressure's zero, which takes its place
ZERO, OFFSET = "pressure_zero", "angle_offset"
LEVEL, CARRIED = "friction_level", "carried_mass"
RUBBING = ("coulomb", "viscous", "stribeck")  # what one factor changes in a cylinder
NEVER = 1e-4  # of what is zero by definition: small against every daily difference
TYPICAL_FRICTION = 1.5e5  # Pa on the head side: dry friction of a cylinder, from which its daily share is reckoned


class Coordinate(NamedTuple):
    """A quantity that is followed: `name` PLACE.QUANTITY, `unit`; standard deviations before any recording: `constant`
    of what a machine always has beyond its data sheet, `daily` of what differs from day to day."""

    name: str
    unit: str
    constant: float
    daily: float

    @property
    def at(self) -> str:
        """Where: a link, a cylinder, or a sensor."""
        return self.name.partition(".")[0]

    @property
    def quantity(self) -> str:
        """What is there."""
        return self.name.rpartition(".")[2]


def followed_model(service: Service) -> Model:
    """The model of which the parameters are followed: with all friction laws that the machine file allows, whichever a
    single recording would choose, so that all recordings have the same parameters."""
    laws = tuple(law for law in FRICTION if law in service.effects and law != DIRECTIONAL)
    return Model(service.machine, service.filters, laws)


def sensor_errors(machine: Machine) -> tuple[Proposal, ...]:
    """One zero for each cylinder that has a pressure sensor (both sides' zeros look alike), then every angle."""
    own = proposals(machine, ((PressureOffset(),),))
    first = {machine.signals[p.where].index: p for p in reversed(own) if machine.signals[p.where].kind in _PRESSURES}
    return (*(first[c] for c in sorted(first)), *proposals(machine, ((AngleOffset(),),)))


_PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)


def coordinates(model: Model) -> tuple[Coordinate, ...]:
    """All that is followed (K,), in the order of the columns of `evidence`."""
    spread, areas = np.sqrt(np.diag(model.prior.covariance)), {c.name: c.area_head for c in model.machine.cylinders}
    found = [
        Coordinate(p.name, p.unit, float(s), _daily(model, p.name, areas))
        for p, s in zip(model.parameters, spread, strict=True)
    ]
    return (*found, *(_of_sensor(model.machine, p) for p in sensor_errors(model.machine)))


def _of_sensor(machine: Machine, p: Proposal) -> Coordinate:
    if p.name == AngleOffset().about.name:
        return Coordinate(f"{p.at}.{OFFSET}", p.about.unit.split()[0], p.about.high, VARYING_CHANGE * p.about.low)
    cylinder = machine.cylinders[machine.signals[p.where].index]
    return Coordinate(f"{cylinder.name}.{ZERO}", p.about.unit, p.about.high, EXPECTED.zero)


def _daily(model: Model, name: str, areas: dict[str, float]) -> float:
    """What the diagnosis takes for an everyday difference of a parameter before a fleet shows it."""
    at, _, symbol = name.rpartition(".")
    moment = VARYING_CHANGE * FirstMomentChange().about.low
    if symbol in ("coulomb", "viscous"):
        force = EXPECTED.friction * TYPICAL_FRICTION * areas[at]
        return force if symbol == "coulomb" else force / SPEED
    laws = {"load_dependent": LoadDependentFriction().about, "delay": Delay().about, "stribeck": Stribeck().about}
    if symbol in laws:
        return (CREEP_CHANGE if laws[symbol].name in CREEP else VARYING_CHANGE) * laws[symbol].low
    if symbol in ("J", "D_excess", "E"):
        return moment * next(link.length for link in model.machine.links if link.name == at)
    return moment


def joint_coordinates(model: Model) -> tuple[Coordinate, ...]:
    """What moves several of the quantities together from day to day (L,): all friction of a cylinder, with its
    temperature, and a mass on a link, such as dirt. A machine has none of it lastingly: the quantities contain it."""
    level, mass = FrictionLevelChange().about, ExtraMass().about
    frictions = [Coordinate(f"{c.name}.{LEVEL}", level.unit, NEVER, EXPECTED.friction) for c in model.machine.cylinders]
    names = [model.machine.links[j].name for j in model.machine.rows]
    masses = [Coordinate(f"{name}.{CARRIED}", mass.unit, NEVER, VARYING_CHANGE * mass.low) for name in names]
    return (*frictions, *masses)


def joint_directions(model: Model, own: Array) -> Array:
    """(K, L): by how much these move each quantity of a machine whose own quantities are `own` (K,)."""
    machine, place = model.machine, {p.name: k for k, p in enumerate(model.parameters)}
    found = np.zeros((len(own), len(machine.cylinders) + len(machine.rows)))
    for k, cylinder in enumerate(machine.cylinders):
        rubbing = [place[n] for law in RUBBING if (n := f"{cylinder.name}.{law}") in place]
        found[rubbing, k] = np.maximum(own[rubbing], 0.0)
    for k, j in enumerate(machine.rows, len(machine.cylinders)):
        found[: 3 * machine.size, k] = ExtraMass().change(machine, j)[:, 0]
    return found


SPEED = 0.3  # m/s, at which viscous friction is as large as the dry one


def data_sheet(model: Model) -> Array:
    """What the machine file says of each quantity (K,)."""
    return np.concatenate([model.prior.mean, np.zeros(len(coordinates(model)) - len(model.parameters))])
