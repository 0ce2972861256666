"""The quantities that are followed over a machine's recordings.

They are the parameters of its model, the zeros of its pressure sensors, and the offsets of its angle sensors.
"""

from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.constants import VARYING_CHANGE
from cylforce.diagnosis.model import RUN_TO_RUN_CHANGE
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

DIRECTIONAL = "directional"  # friction law that cannot be distinguished from a pressure's zero, which replaces it
ZERO, OFFSET = "pressure_zero", "angle_offset"
LEVEL, CARRIED = "friction_level", "carried_mass"
RUBBING = ("coulomb", "viscous", "stribeck")  # laws of a cylinder that one factor changes together
NEVER = 1e-4  # prior standard deviation of what is zero by definition: small against every daily difference
TYPICAL_FRICTION = 1.5e5  # Pa on the head side, dry friction of a cylinder, for its day-to-day spread; chosen


class Coordinate(NamedTuple):
    """A quantity that is followed.

    name: PLACE.QUANTITY
    unit: its unit
    constant: prior standard deviation of a machine's constant difference from its data sheet
    daily: prior standard deviation of the difference from day to day
    """

    name: str
    unit: str
    constant: float
    daily: float

    @property
    def at(self) -> str:
        """Return the location: a link, a cylinder, or a sensor."""
        return self.name.partition(".")[0]

    @property
    def quantity(self) -> str:
        """Return the quantity without its location."""
        return self.name.rpartition(".")[2]


def followed_model(service: Service) -> Model:
    """Return the model whose parameters are followed.

    It has all friction laws that the machine file allows, whichever a single recording would choose, so that all
    recordings have the same parameters.
    """
    laws = tuple(law for law in FRICTION if law in service.effects and law != DIRECTIONAL)
    return Model(service.machine, service.filters, laws)


def sensor_errors(machine: Machine) -> tuple[Proposal, ...]:
    """Return one zero for each cylinder with a pressure sensor, then the offset of every angle.

    The zeros of both sides of a cylinder cannot be distinguished.
    """
    zeros = proposals(machine, ((PressureOffset(),),))
    first = {machine.signals[p.where].index: p for p in reversed(zeros) if machine.signals[p.where].kind in _PRESSURES}
    return (*(first[c] for c in sorted(first)), *proposals(machine, ((AngleOffset(),),)))


_PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)


def coordinates(model: Model) -> tuple[Coordinate, ...]:
    """Return all quantities (K,) that are followed, in the order of the columns of `evidence`."""
    spread, areas = np.sqrt(np.diag(model.prior.covariance)), {c.name: c.area_head for c in model.machine.cylinders}
    parameters = [
        Coordinate(p.name, p.unit, float(s), _daily(model, p.name, areas))
        for p, s in zip(model.parameters, spread, strict=True)
    ]
    return (*parameters, *(_of_sensor(model.machine, p) for p in sensor_errors(model.machine)))


def _of_sensor(machine: Machine, p: Proposal) -> Coordinate:
    """Return the quantity of a sensor's zero or offset."""
    if p.name == AngleOffset().about.name:
        return Coordinate(f"{p.at}.{OFFSET}", p.about.unit.split()[0], p.about.high, VARYING_CHANGE * p.about.low)
    cylinder = machine.cylinders[machine.signals[p.where].index]
    return Coordinate(f"{cylinder.name}.{ZERO}", p.about.unit, p.about.high, EXPECTED.zero)


def _daily(model: Model, name: str, areas: dict[str, float]) -> float:
    """Return the day-to-day spread of a parameter before any recording, as the diagnosis assumes it."""
    at, _, symbol = name.rpartition(".")
    moment = VARYING_CHANGE * FirstMomentChange().about.low
    if symbol in ("coulomb", "viscous"):
        force = EXPECTED.friction * TYPICAL_FRICTION * areas[at]
        return force if symbol == "coulomb" else force / SPEED
    laws = {"load_dependent": LoadDependentFriction().about, "delay": Delay().about, "stribeck": Stribeck().about}
    if symbol in laws:
        # a friction or delay that does not vary within a day still drifts from day to day
        return max(RUN_TO_RUN_CHANGE[laws[symbol].varies], VARYING_CHANGE) * laws[symbol].low
    if symbol in ("J", "D_excess", "E"):
        return moment * next(link.length for link in model.machine.links if link.name == at)
    return moment


def joint_coordinates(model: Model) -> tuple[Coordinate, ...]:
    """Return the quantities that change several others together from day to day (L,).

    They are the friction level of each cylinder, which follows its temperature, and a mass on each link, such as dirt.
    Their constant value is zero: the other quantities contain it.
    """
    level, mass = FrictionLevelChange().about, ExtraMass().about
    frictions = [Coordinate(f"{c.name}.{LEVEL}", level.unit, NEVER, EXPECTED.friction) for c in model.machine.cylinders]
    names = [model.machine.links[j].name for j in model.machine.rows]
    masses = [Coordinate(f"{name}.{CARRIED}", mass.unit, NEVER, VARYING_CHANGE * mass.low) for name in names]
    return (*frictions, *masses)


def joint_directions(model: Model, values: Array) -> Array:
    """Return the change (K, L) of each quantity of a machine by these.

    values: (K,) the machine's quantities
    """
    machine, place = model.machine, {p.name: k for k, p in enumerate(model.parameters)}
    directions = np.zeros((len(values), len(machine.cylinders) + len(machine.rows)))
    for k, cylinder in enumerate(machine.cylinders):
        rubbing = [place[n] for law in RUBBING if (n := f"{cylinder.name}.{law}") in place]
        directions[rubbing, k] = np.maximum(values[rubbing], 0.0)
    for k, j in enumerate(machine.rows, len(machine.cylinders)):
        directions[: 3 * machine.size, k] = ExtraMass().change(machine, j)[:, 0]
    return directions


SPEED = 0.3  # m/s, speed at which viscous friction is assumed as large as the dry one; chosen


def data_sheet(model: Model) -> Array:
    """Return the value of each quantity (K,) by the machine file."""
    return np.concatenate([model.prior.mean, np.zeros(len(coordinates(model)) - len(model.parameters))])
