"""Cylinders, valves and pump: two chambers of compressible oil, a flow-compensated inlet, an outlet orifice that a
counterbalance piston throttles while the load drives, make-up and relief valves, a load-sensing pump. SI units.

The inner step of the simulation: Python floats, because numpy costs a microsecond a call. Pressures are above
atmospheric; each chamber's balance is solved implicitly in its own pressure, so that no valve can make it overshoot.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Protocol

import numpy as np

from .friction import Friction


@dataclass(frozen=True, slots=True)
class Hydraulics:
    """Parameters of the hydraulic system that differ between machines."""

    bulk_modulus: float = 1.2e9
    air: float = 8e5  # pressure at which half of the stiffness is lost to entrained air, less 1 bar
    back_pressure: float = 12e5  # across the fully compensated outlet
    pilot: float = 30e5  # inlet pressure at which the counterbalance lets pass 1.3 times the flow wanted
    pilot_lag: float = 0.3
    hose_loss: float = 0.005  # s: the hoses' walls give way with that delay
    margin: float = 12e5  # the inlet compensator's
    droop: float = 0.12  # of the inlet flow lost per 100 bar of inlet pressure above its slow mean
    spool_lag: float = 0.035
    relief: float = 380e5
    leak: float = 2e-13  # m^3/s/Pa past the piston
    hose_volume: float = 0.0025
    pump_flow: float = 6.8e-3
    pump_margin: float = 22e5
    pump_standby: float = 25e5
    pump_limit: float = 343e5
    pump_lag: float = 0.04
    tank: float = 3e5
    return_loss: float = 1.2e10  # Pa/(m^3/s)^2: 5 bar at 6.5 l/s


def draw_hydraulics(rng: np.random.Generator) -> Hydraulics:
    """Those of one machine."""
    return Hydraulics(
        bulk_modulus=float(rng.uniform(1.0e9, 1.4e9)),
        tank=float(rng.uniform(2e5, 5e5)),
        back_pressure=float(rng.uniform(9e5, 16e5)),
        return_loss=float(rng.uniform(0.8e10, 1.6e10)),
    )


ROUNDING = 2e4  # Pa below which an orifice is linear
MAKE_UP = 4e-8  # m^3/s/Pa
OPEN_RELIEF = 2e-8
STOP_STIFFNESS, STOP_DAMPING = 4e7, 2e5


class Linkage(Protocol):
    """What turns a joint angle into a cylinder's length."""

    def span(self, angle: float) -> tuple[float, float]:
        """Length [m] and d(length)/d(angle) [m/rad]."""
        ...


class Chamber:
    """One side of a cylinder: `area`, the oil's `volume` with the piston at its stop, `sign` +1 where the volume grows
    with the length, `pressure` of the oil in the hoses, `port`: at the piston and at the sensor, where the hoses' lossy
    walls add to it while it changes."""

    __slots__ = ("area", "dead", "half", "loss", "modulus", "port", "pressure", "relief", "sign", "stop")

    def __init__(self, area: float, stop: float, sign: float, figures: Hydraulics) -> None:
        self.area, self.stop, self.sign = area, stop, sign
        self.dead = figures.hose_volume + 0.04 * area
        self.modulus, self.half, self.relief = figures.bulk_modulus, figures.air, figures.relief
        self.pressure = self.port = figures.tank
        self.loss = figures.hose_loss

    def fill(self, length: float, moved: float, inflow: float, slope: float, tank: float, dt: float) -> None:
        """The pressure after `dt`, with `inflow` at the old pressure and `slope` = -d(inflow)/d(pressure)."""
        p = self.pressure
        if p < tank:
            inflow += MAKE_UP * (tank - p)
            slope += MAKE_UP
        elif p > self.relief:
            inflow -= OPEN_RELIEF * (p - self.relief)
            slope += OPEN_RELIEF
        volume = self.dead + self.area * self.sign * (length - self.stop)
        stiffness = self.modulus * (p + 1e5) / ((p + 1e5 + self.half) * volume)
        p += stiffness * (inflow * dt - self.sign * self.area * moved) / (1.0 + stiffness * slope * dt)
        p = max(0.0, p)
        port = p + self.loss * (p - self.pressure) / dt
        self.port = max(0.0, port)
        self.pressure = p


class Cylinder:
    """A cylinder with its linkage, valve section and friction. After `advance`: `length`, `lever` d(length)/d(angle),
    `speed`, `force` (pressures and stops), `explicit` and `dry` friction, `inlet` pressure, `outflow`."""

    __slots__ = (
        "across", "command", "dry", "dt", "explicit", "figures", "force", "friction", "head", "inlet", "length",
        "lengths", "lever", "mean", "opening", "outflow", "rod", "span", "speed", "spool",
    )  # fmt: skip

    def __init__(
        self,
        linkage: Linkage,
        areas: tuple[float, float],
        lengths: tuple[float, float],
        friction: Friction,
        figures: Hydraulics,
        dt: float,
    ) -> None:
        self.span, self.lengths, self.figures, self.dt = linkage.span, lengths, figures, dt
        self.head, self.rod = Chamber(areas[0], lengths[0], 1.0, figures), Chamber(areas[1], lengths[1], -1.0, figures)
        self.friction = friction
        self.command = self.spool = self.speed = self.force = self.explicit = self.dry = self.outflow = 0.0
        self.inlet, self.opening, self.mean, self.across = figures.tank, 0.5, figures.tank, figures.pilot

    def balance(self, angle: float, force: float) -> None:
        """Pressures that hold `force` at rest, 8 bar on the side that carries no load."""
        self.length, self.lever = self.span(angle)
        low = 8e5
        head, rod = self.head, self.rod
        head.pressure = head.port = max(low, (force + low * rod.area) / head.area)
        rod.pressure = rod.port = max(low, (low * head.area - force) / rod.area)
        self.force = head.pressure * head.area - rod.pressure * rod.area

    def advance(self, angle: float, supply: float, tank: float) -> None:
        """One step to the joint's new angle, between the pump's and the return line's pressures."""
        length, self.lever = self.span(angle)
        moved, dt = length - self.length, self.dt
        self.length, speed = length, moved / dt
        self.speed = speed
        head, rod = self.head, self.rod
        into, grows, out, falls = self._valve(supply, tank)
        leak = self.figures.leak
        past = leak * (head.pressure - rod.pressure)
        if self.spool >= 0.0:
            head.fill(length, moved, into - past, grows + leak, tank, dt)
            rod.fill(length, moved, past - out, falls + leak, tank, dt)
        else:
            head.fill(length, moved, -out - past, falls + leak, tank, dt)
            rod.fill(length, moved, into + past, grows + leak, tank, dt)
        on_head, on_rod = head.port * head.area, rod.port * rod.area
        oil = on_head - on_rod
        self.explicit, self.dry = self.friction.step(speed, oil, on_head, on_rod)
        self.force = oil + self._stops(length, speed) if not self.lengths[0] < length < self.lengths[1] else oil

    def _valve(self, supply: float, tank: float) -> tuple[float, float, float, float]:
        """Flow in and out and how fast they fall with their chamber's pressure."""
        f = self.figures
        spool = self.spool = self.spool + (self.command - self.spool) * (self.dt / f.spool_lag)
        inlet, outlet = (self.head, self.rod) if spool >= 0.0 else (self.rod, self.head)
        wanted = abs(spool)
        if wanted < 1e-4:  # m/s: the spool is in its overlap
            self.outflow = self.inlet = 0.0
            self.across, self.opening = f.pilot, 0.5
            return 0.0, 0.0, 0.0, 0.0
        p = self.inlet = inlet.pressure
        self.mean += (p - self.mean) * (self.dt / 0.5)
        flow = wanted * inlet.area * (1.0 - f.droop * (p - self.mean) * 1e-7)
        drop, slope = supply - p, wanted * inlet.area * f.droop * 1e-7
        if drop <= 0.0:  # the check valve closes
            flow = slope = 0.0
        elif drop < f.margin:
            slope = flow / f.margin
            flow *= drop / f.margin
        across = outlet.pressure - tank
        self.across += (across - self.across) * (self.dt / f.pilot_lag)
        # a driving load leaves the inlet empty: the counterbalance throttles its outlet to the flow wanted, a little
        # more or less as the inlet's pressure tells
        held = sqrt(f.back_pressure / self.across) if self.across > f.back_pressure else 1.0
        opening = held * (0.7 + 0.6 * p / f.pilot)
        self.opening += ((min(1.0, opening)) - self.opening) * (self.dt / f.pilot_lag)
        per_root = wanted * outlet.area * self.opening / sqrt(f.back_pressure) / sqrt(abs(across) + ROUNDING)
        self.outflow = per_root * across
        return flow, slope, self.outflow, per_root

    def _stops(self, length: float, speed: float) -> float:
        low, high = self.lengths
        depth = low - length if length < low else high - length
        return STOP_STIFFNESS * depth - STOP_DAMPING * speed


class Pump:
    """Load-sensing: the highest inlet pressure plus a margin; the return line's pressure rises with its flow."""

    __slots__ = ("figures", "follow", "supply", "tank")

    def __init__(self, figures: Hydraulics, dt: float) -> None:
        self.figures, self.supply, self.tank = figures, figures.pump_standby, figures.tank
        self.follow = dt / figures.pump_lag

    def advance(self, cylinders: list[Cylinder]) -> None:
        """One step of the supply's and of the return line's pressures."""
        f = self.figures
        highest = outflow = 0.0
        for c in cylinders:
            outflow += c.outflow
            highest = max(highest, c.inlet)
        wanted = min(max(highest + f.pump_margin, f.pump_standby), f.pump_limit)
        self.supply += (wanted - self.supply) * self.follow
        self.tank += (f.tank + f.return_loss * outflow * abs(outflow) - self.tank) * self.follow

    def shared(self, commands: list[float], cylinders: list[Cylinder]) -> list[float]:
        """Speeds that the pump's flow allows: all less in the same proportion."""
        wanted = sum(abs(v) * (c.head if v > 0.0 else c.rod).area for v, c in zip(commands, cylinders, strict=True))
        share = min(1.0, self.figures.pump_flow / wanted) if wanted > 0.0 else 1.0
        return [share * v for v in commands]
