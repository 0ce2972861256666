"""Runs a loader's plan at 1 kHz: MuJoCo for the bodies; cylinders, valves and friction around it, in Python floats."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reference_machine.engine import DT, SETTLE, STEPS, turning
from reference_machine.friction import Friction, PinFriction
from reference_machine.hydraulics import Cylinder, Hydraulics, Linkage, Pump
from reference_machine.plan import RATE

from .bodies import Bodies
from .geometry import Geometry
from .sheet import CYLINDERS, JOINTS
from .specimen import Specimen
from .work import LoaderPlan
from .zbar import tip

Array = NDArray[np.float64]
FAST = 10  # columns of `Trace.fast`
TRUE_COLUMNS = (
    *(f"{what}.{j}" for what in ("theta", "theta_rate") for j in JOINTS),
    *(f"{what}.{c}" for what in ("length", "force") for c in CYLINDERS),
    *("tip_x", "tip_z", "tip_force_x", "tip_force_z", "drive_acceleration", "rock", "rock_rate"),
)


@dataclass
class Plant:
    """All physics of a run."""

    specimen: Specimen
    friction: list[Friction]
    pins: list[PinFriction | None]
    hydraulics: Hydraulics
    pitch: float = 0.0
    roll: float = 0.0


@dataclass
class Trace:
    """What happened. `fast` (10 T, FAST) at 1 kHz: pressures head and rod of each cylinder, angles; the base's
    acceleration along x, its rocking angle, rate and acceleration; `true` (T, K): TRUE_COLUMNS at 100 Hz."""

    fast: Array
    true: Array


class Engine:
    """One run of one plan."""

    def __init__(self, plant: Plant, plan: LoaderPlan) -> None:
        self.plant, self.plan, s = plant, plan, plant.specimen
        self.bodies = Bodies(s, DT, plant.pitch, plant.roll)
        self.zbar = self.bodies.zbar
        linkages: tuple[Linkage, ...] = (self.bodies.lift, self.zbar)
        self.cylinders = [
            Cylinder(linkage, s.areas(name), s.cylinders[name].lengths, friction, plant.hydraulics, DT)
            for linkage, name, friction in zip(linkages, CYLINDERS, plant.friction, strict=True)
        ]
        self.pump = Pump(plant.hydraulics, DT)
        self._missing, self._turning = [0.0, 0.0], [0.0, 0.0]
        self._begin()

    def _begin(self) -> None:
        """The first pose, with pressures that balance it."""
        plan, bodies = self.plan, self.bodies
        arm, bucket = Geometry(self.plant.specimen).angles(plan.lengths[0])
        bodies.place(arm, bucket)
        bodies.load(*plan.payload[0].tolist())
        bodies.forward()
        on_arm, on_bucket = (float(bodies.data.qfrc_bias[k]) for k in bodies.joints)
        lift, tilt = self.cylinders
        self.zbar.lifted = arm
        tilt.balance(bucket, 0.0)
        tilt.balance(bucket, on_bucket / tilt.lever)
        lift.balance(arm, 0.0)
        lift.balance(arm, (on_arm - tilt.force * self.zbar.arm_lever) / lift.lever)

    def run(self) -> Trace:
        """The whole plan, row by row, after a moment at its first pose."""
        for _ in range(round(SETTLE * RATE)):
            self._row(0, None)
        plan, true = self.plan, np.zeros((self.plan.rows, len(TRUE_COLUMNS)))
        packed = np.zeros((plan.rows * STEPS, FAST))
        for k in range(plan.rows):
            fast: list[float] = []
            true[k] = self._row(k, fast)
            packed[k * STEPS : (k + 1) * STEPS] = np.array(fast).reshape(STEPS, FAST)
        return Trace(packed, true)

    def _row(self, k: int, log: list[float] | None) -> list[float]:
        """One row of the plan: commands and conditions, then ten steps of physics."""
        plan = self.plan
        self._turning = turning(plan.lengths, k, self._missing, self.cylinders, self.pump)
        self.bodies.load(*plan.payload[k].tolist())
        for cylinder in self.cylinders:
            cylinder.friction.condition(float(plan.kelvin[k]), float(plan.wear[k]))
        now, ahead = plan.base[k], plan.base[min(k + 1, plan.rows - 1)]
        truth: list[float] = []
        for step in range(STEPS):
            for cylinder, by in zip(self.cylinders, self._turning, strict=True):
                cylinder.command += by
            speed, forward, angle, rate, turn = (now + (ahead - now) * (step / STEPS)).tolist()
            self.bodies.carry((speed, forward), (angle, rate, turn))
            self._advance(plan.tip[k].tolist(), log)
            truth = truth or self._truth(plan.tip[k].tolist())
        return truth

    def _advance(self, on_teeth: list[float], log: list[float] | None) -> None:
        """One millisecond: lengths give pressures, pressures give torques, torques move MuJoCo's bodies."""
        data, bodies = self.bodies.data, self.bodies
        (a, b), (lift, tilt) = bodies.joints, self.cylinders
        arm, bucket = float(data.qpos[a]), float(data.qpos[b])
        self.zbar.lifted = arm
        lift.advance(arm, self.pump.supply, self.pump.tank)
        tilt.advance(bucket, self.pump.supply, self.pump.tank)
        self.pump.advance(self.cylinders)
        pushes, pulls = lift.force - lift.explicit, tilt.force - tilt.explicit
        torques = [pushes * lift.lever + pulls * self.zbar.arm_lever, pulls * tilt.lever]
        x, z = tip(self.plant.specimen, arm, bucket)
        fx, fz = on_teeth
        pin = self.plant.specimen.lengths["arm"]
        torques[0] += x * fz - z * fx
        torques[1] += (x - pin * np.cos(arm)) * fz - (z - pin * np.sin(arm)) * fx
        for joint, k, cylinder in zip(self.plant.pins, (a, b), self.cylinders, strict=True):
            data.qfrc_applied[k] = torques.pop(0) - (joint.step(float(data.qvel[k]), cylinder.force) if joint else 0.0)
        for k, cylinder in zip(bodies.rods, self.cylinders, strict=True):
            bodies.model.dof_frictionloss[k] = cylinder.dry
        bodies.step()
        if log is not None:
            pressures = (lift.head.port, lift.rod.port, tilt.head.port, tilt.rod.port)
            log.extend((*pressures, float(data.qpos[a]), float(data.qpos[b]), *bodies.base()))

    def _truth(self, on_teeth: list[float]) -> list[float]:
        """TRUE_COLUMNS."""
        data, (a, b), (lift, tilt) = self.bodies.data, self.bodies.joints, self.cylinders
        arm, bucket = float(data.qpos[a]), float(data.qpos[b])
        moved = [arm, bucket, float(data.qvel[a]), float(data.qvel[b])]
        place = tip(self.plant.specimen, arm, bucket)
        return [
            *moved,
            *(lift.length, tilt.length, lift.force, tilt.force),
            *place,
            *on_teeth,
            *self.bodies.base()[:3],
        ]
