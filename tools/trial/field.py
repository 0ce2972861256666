"""A machine's clean recordings, shared by its cases, and what a fault makes of them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from reference_machine.datasheet import JOINTS
from reference_machine.engine import Trace
from reference_machine.machine import Machine, Stage, draw
from reference_machine.plan import Plan

from .fault import Fault, Scene, Stretch, same_physics

Array = NDArray[np.float64]
LOAD_KG = 1000.0
PAUSE_S = 30.0  # between the field's recordings
EMPTY, LOADED = "field_empty", "field_loaded"


@dataclass(frozen=True)
class Lengths:
    """Durations [s] of the recordings."""

    reference_empty: float = 240.0
    reference_loaded: float = 90.0
    field_empty: float = 100.0
    field_loaded: float = 100.0


@dataclass(frozen=True)
class Piece:
    """A recording of the field before its sensors are read: what the clean machine did there."""

    stretch: Stretch
    machine: Machine
    stage: Stage
    plan: Plan

    @cached_property
    def clean(self) -> Trace:
        """What the clean machine does."""
        return self.machine.trace(self.plan, self.stage.pitch, self.stage.roll)

    def values(self, machine: Machine, seed: tuple[int, ...]) -> Array:
        """What the sensors of a machine say (T, S): the motion asked for and the noise are the same for all."""
        plan = machine.edited(self.plan)
        same = same_physics(machine, self.machine)
        trace = self.clean if same else machine.trace(plan, self.stage.pitch, self.stage.roll)
        return machine.measured(trace, plan, self.stage, np.random.default_rng([*seed, len(self.stretch.name)]))


class Site:
    """A drawn machine: reference recordings, made once, and the field's pieces."""

    def __init__(self, seed: int, friction: str, lengths: Lengths) -> None:
        self.seed, self.lengths = seed, lengths
        self.machine = draw(seed, friction=friction)

    @cached_property
    def references(self) -> dict[str, Array]:
        """Values (T, S) of the clean machine, empty and with the known load."""
        empty = self.machine.run("commissioning", seed=0, duration_s=self.lengths.reference_empty, slew=True)
        loaded = self.machine.run(
            "commissioning", seed=1, duration_s=self.lengths.reference_loaded, slew=True, payload_kg=LOAD_KG
        )
        return {"reference_empty": empty.values, "reference_loaded": loaded.values}

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """The field of a usual case: motions and slopes of its own."""
        return self.field(np.random.default_rng([self.seed, 5]), 2)

    def field(self, rng: np.random.Generator, run: int, poor: str = "") -> tuple[Piece, ...]:
        """A field; `poor` names what its motion lacks."""
        seconds = dict(zip((EMPTY, LOADED), (self.lengths.field_empty, self.lengths.field_loaded), strict=True))
        if poor == "short":
            seconds = dict.fromkeys(seconds, min(15.0, self.lengths.field_empty))
        if poor in ("empty_only", "no_load"):
            del seconds[LOADED]
        pieces, begin = [], 0.0
        for name, duration in seconds.items():
            pieces.append(self._piece(name, begin, duration, rng, run + len(pieces), poor))
            begin += duration + PAUSE_S
        return tuple(pieces)

    def _piece(self, name: str, begin: float, duration: float, rng: np.random.Generator, run: int, poor: str) -> Piece:
        load = LOAD_KG if name == LOADED else 0.0
        slope = {"pitch_deg": float(rng.uniform(-5.0, 5.0)), "roll_deg": float(rng.uniform(-3.0, 3.0))}
        stage = self.machine.stage(
            "commissioning",
            seed=run,
            duration_s=duration,
            oil_degc=40.0 + 0.0125 * begin,
            slew=not poor,
            payload_kg=load,
            **slope,
        )
        (plan,) = stage.plans
        plan = lacking(plan, poor, int(rng.integers(3)))
        return Piece(Stretch(name, begin, duration, stage.pitch, stage.roll, load), self.machine, stage, plan)


def lacking(plan: Plan, poor: str, joint: int) -> Plan:
    """A plan in which one joint moves alone, or all move six times slower."""
    lengths = plan.lengths
    if poor == "one_joint":
        lengths = np.tile(lengths[0], (plan.rows, 1))
        lengths[:, joint] = plan.lengths[:, joint]
    if poor == "slow":
        at = np.arange(plan.rows) / 6.0
        columns = [np.interp(at, np.arange(plan.rows), plan.lengths[:, k]) for k in range(len(JOINTS))]
        lengths = np.stack(columns, axis=-1)
    return replace(plan, lengths=lengths)


def scene(pieces: tuple[Piece, ...]) -> Scene:
    """What faults are fitted to."""
    return Scene(pieces[0].machine, tuple(piece.stretch for piece in pieces))


def faulty(piece: Piece, faults: list[Fault]) -> Machine:
    """The piece's machine with all faults, one after the other."""
    machine = piece.machine
    for fault in faults:
        machine = fault.apply(machine, piece.stretch)
    return machine
