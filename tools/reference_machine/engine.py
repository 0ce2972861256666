"""Runs a plan at 1 kHz: MuJoCo for the bodies; own cylinders, valves, friction and soil around it, in Python floats."""

from dataclasses import dataclass
from math import cos, sin
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .arm import Arm
from .datasheet import JOINTS
from .friction import Friction, PinFriction
from .geometry import Geometry
from .hydraulics import Cylinder, Hydraulics, Pump
from .plan import RATE, Plan
from .soil import contact
from .specimen import Specimen

Array = NDArray[np.float64]
STEPS = 10  # of one millisecond in a row of the plan
DT = 1.0 / (RATE * STEPS)
SETTLE = 1.5  # s at the first pose before the recording begins
GAIN = 1.3  # 1/s: speed asked for per length still missing
SEEING = 0.3  # s: an operator does not follow the machine's vibration
FASTEST = 0.34  # m/s
CLOSE_ENOUGH = 0.008  # m: the operator leaves it there
SLEW_STIFFNESS, SLEW_DAMPING, SLEW_TORQUE = 6e6, 1.1e6, 9e4
NEAR_GROUND = 0.6  # m
TRUE_COLUMNS = (
    *(f"{what}.{j}" for what in ("theta", "theta_rate", "theta_acceleration") for j in JOINTS),
    *(f"{what}.{j}" for what in ("length", "lever", "force", "friction", "pin_torque") for j in JOINTS),
    *(f"{side}.{j}" for side in ("head", "rod") for j in JOINTS),
    *("slew", "slew_rate", "supply", "tank", "tip_x", "tip_z", "tip_force_x", "tip_force_z"),
)  # fmt: skip


class ExtraTorque(Protocol):
    """A force beyond those built in: a hose's spring, a cushion, ..."""

    def __call__(self, t: float, angles: list[float], rates: list[float]) -> tuple[float, float, float]:
        """Torques on (boom, stick, bucket) [N m] at a time [s] and a state [rad, rad/s]."""
        ...


@dataclass
class Plant:
    """All physics of a run; each part can be replaced before it."""

    specimen: Specimen
    friction: list[Friction]
    pins: list[PinFriction | None]
    hydraulics: Hydraulics
    pitch: float = 0.0
    roll: float = 0.0
    extra: tuple[ExtraTorque, ...] = ()


@dataclass
class Trace:
    """What happened. `fast` (10 T, 11): pressures head and rod of each cylinder, angles, slew, slew rate at 1 kHz;
    `true` (T, K): TRUE_COLUMNS at 100 Hz."""

    fast: Array
    true: Array


def turning(lengths: Array, k: int, missing: list[float], cylinders: list[Cylinder], pump: Pump) -> list[float]:
    """By how much each cylinder's command changes within every step of row k, so that it has the speed of the planned
    `lengths` (T, C) at the row's end and makes up for what is `missing` [m], which is seen late and updated here."""
    now, ahead = lengths[k], lengths[min(k + 1, len(lengths) - 1)]
    speeds = ((ahead - now) * RATE).tolist()
    wanted = []
    for j, (target, speed, cylinder) in enumerate(zip(now.tolist(), speeds, cylinders, strict=True)):
        missing[j] += (target - cylinder.length - missing[j]) / (SEEING * RATE)
        rests = speed == 0.0 and abs(missing[j]) < CLOSE_ENOUGH
        asked = 0.0 if rests else speed + GAIN * missing[j]
        wanted.append(min(max(asked, -FASTEST), FASTEST))
    shared = pump.shared(wanted, cylinders)
    return [(speed - c.command) / STEPS for speed, c in zip(shared, cylinders, strict=True)]


class Engine:
    """One run of one plan."""

    def __init__(self, plant: Plant, plan: Plan) -> None:
        self.plant, self.plan = plant, plan
        self.arm = Arm(plant.specimen, DT, plant.pitch, plant.roll)
        s = plant.specimen
        self.cylinders = [
            Cylinder(s.linkage(j), s.areas(j), s.cylinders[j].lengths, plant.friction[k], plant.hydraulics, DT)
            for k, j in enumerate(JOINTS)
        ]
        self.pump = Pump(plant.hydraulics, DT)
        self.tip_force, self.tip = (0.0, 0.0), (0.0, 0.0)
        self._missing, self._turning = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        self._arms = (s.lengths["boom"], s.lengths["stick"], *s.tool)
        self._begin()

    def _begin(self) -> None:
        """The first pose, with pressures that balance it."""
        plan, arm = self.plan, self.arm
        angles = Geometry(self.plant.specimen).exact_angles(plan.lengths[0])
        arm.place(float(plan.slew[0]), tuple(angles))
        arm.load(*plan.payload[0].tolist())
        arm.forward()
        for k, cylinder in enumerate(self.cylinders):
            cylinder.balance(angles[k], 0.0)
            cylinder.balance(angles[k], float(arm.data.qfrc_bias[1 + k]) / cylinder.lever)
            cylinder.friction.condition(float(plan.kelvin[0]), float(plan.wear[0]))

    def run(self) -> Trace:
        """The whole plan, row by row."""
        for _ in range(round(SETTLE * RATE)):
            self._row(0, None)
        return self._rows()

    def go_on(self, plan: Plan) -> Trace:
        """Carry out another plan from the present state."""
        self.plan = plan
        return self._rows()

    def _rows(self) -> Trace:
        plan = self.plan
        fast: list[float] = []
        true = np.zeros((plan.rows, len(TRUE_COLUMNS)))
        packed = np.zeros((plan.rows * STEPS, 11))
        for k in range(plan.rows):
            fast.clear()
            true[k] = self._row(k, fast)
            packed[k * STEPS : (k + 1) * STEPS] = np.array(fast).reshape(STEPS, 11)
        return Trace(packed, true)

    def _row(self, k: int, log: list[float] | None) -> list[float]:
        """One row of the plan: commands and conditions, then ten steps of physics."""
        plan, arm = self.plan, self.arm
        self._command(k)
        arm.load(*plan.payload[k].tolist())
        for cylinder in self.cylinders:
            cylinder.friction.condition(float(plan.kelvin[k]), float(plan.wear[k]))
        known = plan.tip[k].tolist()
        slew = (float(plan.slew[k]), float(plan.slew[k] - plan.slew[k - 1]) * RATE if k else 0.0)
        touches = self._near_ground() or known != [0.0, 0.0]
        truth: list[float] = []
        for step in range(STEPS):
            for cylinder, turning in zip(self.cylinders, self._turning, strict=True):
                cylinder.command += turning
            self._advance(slew, known if touches else None, plan.begin + (k + step / STEPS) / RATE, log)
            if step == 0:
                truth = self._truth()
        return truth

    def _command(self, k: int) -> None:
        """Speeds asked for at the row's end: the plan's, and what brings the length back to it. Within the row
        they change linearly: steps at the sensors' period would jerk the arm in time with the samples."""
        self._turning = turning(self.plan.lengths, k, self._missing, self.cylinders, self.pump)

    def _advance(self, slew: tuple[float, float], known: list[float] | None, t: float, log: list[float] | None) -> None:
        """One millisecond: lengths give pressures, pressures give torques, torques move MuJoCo's bodies."""
        data = self.arm.data
        q, v = data.qpos[:4].tolist(), data.qvel[:4].tolist()
        supply, tank = self.pump.supply, self.pump.tank
        torques = []
        for cylinder, pin, angle, rate, k in zip(self.cylinders, self.plant.pins, q[1:], v[1:], (1, 2, 3), strict=True):
            cylinder.advance(angle, supply, tank)
            torque = (cylinder.force - cylinder.explicit) * cylinder.lever
            torques.append(torque - pin.step(rate, cylinder.force) if pin else torque)
            self.arm.model.dof_frictionloss[k] = cylinder.dry * abs(cylinder.lever)
        self.pump.advance(self.cylinders)
        if known is not None:
            torques = [a + b for a, b in zip(torques, self._touch(q, v, known), strict=True)]
        for extra in self.plant.extra:
            torques = [a + b for a, b in zip(torques, extra(t, q[1:], v[1:]), strict=True)]
        turn = SLEW_STIFFNESS * (slew[0] - q[0]) + SLEW_DAMPING * (slew[1] - v[0])
        data.qfrc_applied[:4] = (min(max(turn, -SLEW_TORQUE), SLEW_TORQUE), *torques)
        self._before = (q, v)
        self.arm.step()
        if log is not None:
            a, b, c = self.cylinders
            pressures = (a.head.port, a.rod.port, b.head.port, b.rod.port, c.head.port, c.rod.port)
            log.extend((*pressures, q[1], q[2], q[3], q[0], 0.5 * (v[0] + data.qvel.item(0))))

    def _places(self, q: list[float]) -> tuple[float, float, float, float, float, float]:
        """From the boom pin: stick pin, bucket pin, teeth (x, z)."""
        boom, stick, tx, tz = self._arms
        a, b = q[1], q[1] + q[2]
        c = b + q[3]
        x1, z1 = boom * cos(a), boom * sin(a)
        x2, z2 = x1 + stick * cos(b), z1 + stick * sin(b)
        return x1, z1, x2, z2, x2 + tx * cos(c) - tz * sin(c), z2 + tx * sin(c) + tz * cos(c)

    def _touch(self, q: list[float], v: list[float], known: list[float]) -> tuple[float, float, float]:
        """Joint torques of the soil and of the known force."""
        x1, z1, x2, z2, x, z = self._places(q)
        fx, fz = known
        ground = self.plan.ground
        if ground is not None and z < ground.height:
            w1, w2, w3 = v[1], v[2], v[3]
            vx = -z * w1 - (z - z1) * w2 - (z - z2) * w3
            vz = x * w1 + (x - x1) * w2 + (x - x2) * w3
            gx, gz = contact(ground, x, z, vx, vz)
            fx, fz = fx + gx, fz + gz
        self.tip_force = (fx, fz)
        return x * fz - z * fx, (x - x1) * fz - (z - z1) * fx, (x - x2) * fz - (z - z2) * fx

    def _near_ground(self) -> bool:
        """Also keeps the place of the teeth and forgets the last force."""
        *_, x, z = self._places(self.arm.data.qpos[:4].tolist())
        self.tip, self.tip_force = (x, z), (0.0, 0.0)
        ground = self.plan.ground
        return ground is not None and z < ground.height + NEAR_GROUND

    def _truth(self) -> list[float]:
        """TRUE_COLUMNS at the instant of the last step's forces."""
        data, cs = self.arm.data, self.cylinders
        q, v = self._before
        rates = [0.5 * (a + b) for a, b in zip(v, data.qvel[:4].tolist(), strict=True)]
        held = self._held()
        friction = [c.explicit - held[k] / c.lever for k, c in enumerate(cs)]
        pins = [pin.torque if pin else 0.0 for pin in self.plant.pins]
        row = q[1:] + rates[1:] + data.qacc[1:4].tolist()
        row += [c.length for c in cs] + [c.lever for c in cs] + [c.force for c in cs] + friction + pins
        row += [c.head.port for c in cs] + [c.rod.port for c in cs]
        return [*row, q[0], rates[0], self.pump.supply, self.pump.tank, *self.tip, *self.tip_force]

    def _held(self) -> list[float]:
        """Torques of MuJoCo's dry friction on (boom, stick, bucket) [N m]."""
        data, found = self.arm.data, [0.0, 0.0, 0.0]
        first = data.ne
        for row in range(first, first + data.nf):
            found[int(data.efc_id[row]) - 1] = float(data.efc_force[row])
        return found
