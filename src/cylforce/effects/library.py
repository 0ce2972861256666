"""Library of effects of the diagnosis, in the order in which they are tried."""

from dataclasses import fields, is_dataclass
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

from cylforce.effects.fault import (
    About,
    Alteration,
    BaseMotion,
    Distortion,
    Fault,
    ForceLaw,
    Incident,
    MassChange,
    PartOfFriction,
    Place,
    Share,
    TimeCourse,
    places,
    unnoticed_sizes,
    usual_sizes,
)
from cylforce.effects.friction.asymmetric_friction import AsymmetricFriction
from cylforce.effects.friction.coulomb_friction import CoulombFriction
from cylforce.effects.friction.counterbalance_pressure import CounterbalancePressure
from cylforce.effects.friction.end_cushion import EndCushion
from cylforce.effects.friction.friction_level_change import FrictionLevelChange
from cylforce.effects.friction.friction_temperature_drift import FrictionTemperatureDrift
from cylforce.effects.friction.load_dependent_friction import LoadDependentFriction
from cylforce.effects.friction.pin_friction import PinFriction
from cylforce.effects.friction.presliding_hysteresis import PreslidingHysteresis
from cylforce.effects.friction.return_line_loss import ReturnLineLoss
from cylforce.effects.friction.stribeck import Stribeck
from cylforce.effects.friction.viscous_friction import ViscousFriction
from cylforce.effects.geometry.backlash import Backlash
from cylforce.effects.geometry.boom_motion import BoomMotion
from cylforce.effects.geometry.compliance import Compliance
from cylforce.effects.geometry.linkage_geometry import LinkageGeometry
from cylforce.effects.geometry.ringing_compliance import RingingCompliance
from cylforce.effects.geometry.soft_ground import SoftGround
from cylforce.effects.incidents.clock_fault import ClockFault
from cylforce.effects.incidents.payload_shift import PayloadShift
from cylforce.effects.incidents.payload_spill import PayloadSpill
from cylforce.effects.loads.extra_mass import ExtraMass
from cylforce.effects.loads.first_moment_change import FirstMomentChange
from cylforce.effects.loads.hose_spring import HoseSpring
from cylforce.effects.loads.mud import Mud
from cylforce.effects.loads.slew import Slew
from cylforce.effects.loads.tip_force import TipForce
from cylforce.effects.sensors.angle_offset import AngleOffset
from cylforce.effects.sensors.angle_scale import AngleScale
from cylforce.effects.sensors.delay import Delay
from cylforce.effects.sensors.encoder_eccentricity import EncoderEccentricity
from cylforce.effects.sensors.intermittent_glitch import IntermittentGlitch
from cylforce.effects.sensors.pressure_drift import PressureDrift
from cylforce.effects.sensors.pressure_gain import PressureGain
from cylforce.effects.sensors.pressure_offset import PressureOffset
from cylforce.effects.sensors.pressure_sensor_hysteresis import PressureSensorHysteresis
from cylforce.effects.sensors.pressure_zero_settling import PressureZeroSettling
from cylforce.effects.sensors.tilt_ignored import TiltIgnored
from cylforce.mechanics.machine import Machine

UNKNOWN = "unknown"  # name of a torque that no effect of the library describes (see `effects/unknown.py`)
BOTH = (False, True), (False, True)  # values of `viscous` and of `cold` of FrictionTemperatureDrift
PARTS = 5  # pins and bars of a four-bar linkage, the largest that there is

Group = tuple[Fault, ...]  # effects of one name that act together, each with its own size

# Where a law has a continuous parameter (`shapes`), such as a width or a time constant, it stands here with one to
# three starting values, from which the diagnosis refines it. The values are chosen, evenly over its range.

LIBRARY: tuple[Group, ...] = (
    (CoulombFriction(),),
    (ViscousFriction(),),
    (FrictionLevelChange(),),
    *((Stribeck(width),) for width in (0.007, 0.016, 0.034)),
    *((LoadDependentFriction(easing=easing),) for easing in (0.0, 5e-6)),
    *((AsymmetricFriction(way=way),) for way in (0, 1, -1)),
    (PinFriction(),),
    (CounterbalancePressure(),),
    *((PreslidingHysteresis(way),) for way in (0.0007, 0.003)),
    *((FrictionTemperatureDrift(oil, *which),) for oil in (300.0, 60.0, 1500.0) for which in product(*BOTH)),
    *((FrictionTemperatureDrift(300.0, viscous=viscous, alone=True),) for viscous in (False, True)),
    (ReturnLineLoss(way=1), ReturnLineLoss(way=-1)),
    *((EndCushion(0.08, end),) for end in (1, -1, 0)),
    (PressureOffset(),),
    (PressureGain(),),
    *((PressureDrift(fading),) for fading in (0.0, 1.0 / 300.0)),
    *((PressureZeroSettling(settling),) for settling in (60.0, 600.0)),
    *((PressureSensorHysteresis(opening),) for opening in (0.0, 30e5)),
    (AngleOffset(),),
    (AngleScale(),),
    (EncoderEccentricity(), EncoderEccentricity(across=True)),
    (Delay(),),
    (TiltIgnored(), TiltIgnored(across=True)),
    *((LinkageGeometry(part), LinkageGeometry(part, across=True)) for part in range(PARTS)),
    (ExtraMass(),),
    (FirstMomentChange(),),
    *((Mud(slowing),) for slowing in (0.0, 1.0 / 200.0)),
    *((HoseSpring(cubic=cubic),) for cubic in (False, True)),
    *((Compliance(stiffening),) for stiffening in (0.0, 1e-5)),
    *((RingingCompliance(frequency),) for frequency in (1.5, 4.0)),
    *((Backlash(pushed=pushed),) for pushed in (False, True)),
    (TipForce(),),
    (Slew(),),
    (BoomMotion(),),
    (SoftGround(),),
    (PayloadSpill(),),
    (PayloadShift(),),
    (ClockFault(),),
    (IntermittentGlitch(),),
)


# Effects on friction that a model's friction parameters describe as well.
FRICTION_OF_PARAMETERS = (
    CoulombFriction,
    ViscousFriction,
    LoadDependentFriction,
    AsymmetricFriction,
    FrictionLevelChange,
)


class Proposal(NamedTuple):
    """Group of effects at a location.

    group: the effects
    at:    name of the location
    where: number of the location
    """

    group: Group
    at: str
    where: int

    @property
    def about(self) -> About:
        """Description of the group's first effect, which stands for all."""
        return self.group[0].about

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.about.name

    @property
    def usual(self) -> tuple[float, ...]:
        """Typical sizes of all columns of an effect that lasts, the units of the diagnosis; empty for an incident."""
        return () if self.course else tuple(size for effect in self.group for size in usual_sizes(effect))

    @property
    def unnoticed(self) -> tuple[float, ...]:
        """Standard deviations of the sizes of all columns of a lasting effect among healthy machines, in their units.

        Empty for an incident.
        """
        return () if self.course else tuple(size for effect in self.group for size in unnoticed_sizes(effect))

    @property
    def rubs(self) -> bool:
        """True where it is a force along one cylinder (`ForceLaw`): friction, or pressure lost in the lines."""
        return isinstance(self.group[0], ForceLaw)

    @property
    def is_warming(self) -> bool:
        """True where the friction of all cylinders changes together in the course of a recording, as oil warms."""
        return isinstance(self.group[0], Share) and self.about.place is Place.MACHINE

    @property
    def rides(self) -> bool:
        """True where it is a motion of the body that carries the first link."""
        return isinstance(self.group[0], BaseMotion)

    @property
    def weighs(self) -> bool:
        """True where it is a mass that differs from the data sheet."""
        return isinstance(self.group[0], MassChange)

    @property
    def of_parameters(self) -> bool:
        """True where it changes what the model's parameters describe: masses, or friction of a moving cylinder."""
        return self.weighs or isinstance(self.group[0], FRICTION_OF_PARAMETERS)

    @property
    def bends(self) -> bool:
        """True where its columns depend on its own size: an error of readings, of the machine file or of clocks.

        It is not an unknown torque, which has only the interface of one.
        """
        apart = isinstance(self.group[0], Distortion | Alteration) and self.name != UNKNOWN
        return apart or self.clock

    @property
    def of_dry(self) -> float | None:
        """Largest plausible magnitude as a multiple of the cylinder's dry friction; None: not limited by it."""
        effect = self.group[0]
        return effect.of_dry if isinstance(effect, PartOfFriction) else None

    @property
    def shape(self) -> dict[str, Any]:
        """Values of all fields of the group's first effect by name: its shape parameters and its fixed choices."""
        effect: Any = self.group[0]
        return {f.name: getattr(effect, f.name) for f in (fields(effect) if is_dataclass(effect) else ())}

    @property
    def incidents(self) -> tuple[str, ...]:
        """Names of the columns of an incident (see `fault.INCIDENTAL`); empty for a lasting effect."""
        effect = self.group[0]
        return effect.columns if isinstance(effect, Incident) else ()

    @property
    def clock(self) -> bool:
        """True where it is a clock fault, which shifts all readings after their other errors."""
        return self.course is TimeCourse.CLOCK

    @property
    def course(self) -> TimeCourse | None:
        """Course of the sizes of an incident over time; None for a lasting effect."""
        return _course(self)


@lru_cache(maxsize=1024)  # more than there are on any machine
def _course(proposal: Proposal) -> TimeCourse | None:
    """Return the course of an incident, None for a lasting effect.

    It is cached, because isinstance with a protocol takes longer than the rest.
    """
    effect = proposal.group[0]
    return effect.course if isinstance(effect, Incident) else None


def proposals(machine: Machine, library: tuple[Group, ...] = LIBRARY) -> tuple[Proposal, ...]:
    """Return each group of the library at each location of its kind on this machine, in the order of the library."""
    return tuple(Proposal(group, at, where) for group in library for at, where in places(machine, group[0].about.place))
