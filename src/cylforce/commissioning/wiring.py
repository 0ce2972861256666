"""Is every sensor alive, and where the machine file says? Checked on raw samples: values that repeat although they must
change, an inertial sensor on another axis, and exchanges of two sensors with which the recording would fit."""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.batch import least_squares
from cylforce.estimation.blocks import Factors, chosen
from cylforce.estimation.model import Model
from cylforce.estimation.observation import observed_factors
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.unwrapping import Unwrapping
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import INERTIAL, Kind
from cylforce.signals.units import DEGREE

KEPT_S = 40.0  # s of the latest samples that are kept for trying exchanges; chosen
SHORT_S = 8.0  # s of samples, below which no exchange is tried; chosen
FROZEN_S = 1.0  # s of one and the same pressure while its cylinder moves: the sensor is frozen; chosen
STILL_S = 5.0  # s of one and the same angle, without even noise, while a joint moves: the sensor is frozen; chosen
TURNING = 0.01  # rad/s, from which on a joint counts as moving; chosen
WINDOW_S = 0.25  # s over which that rate is measured; chosen
MISFIT = 0.03  # of the torque, unexplained: beyond it a sensor is suspected; chosen
BETTER = 0.25  # of the misfit, which may remain after the right exchange; chosen
AS_MANY = 0.8  # of the usable samples, which must remain usable after the right exchange; chosen

# Mounted by hand a sensor is within 2 to 3 degrees, and accelerometers are within 2 to 3 % of gravity; the base's own
# acceleration averages out over the samples.
ALIGNED, EXACT = 6.0 * DEGREE, 0.06
ROCKS = 0.01  # rad/s rms of the pitch, from which on the sign of its rate is seen: twenty times the sensors' noise

FROZEN = "frozen"  # cause of a suspicion for which there is no other explanation

PLACES = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION, Kind.CYLINDER_LENGTH)
PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)
Exchange = tuple[tuple[int, ...], tuple[int, ...]]


class SignalHistory(NamedTuple):
    """The latest samples `kept` (K, S); per signal (S,): number of samples for which it has `repeated` one value
    although it should change, up to now and the `longest` such time; its smallest change `step` [SI]."""

    kept: Array
    repeated: NDArray[np.intp]
    longest: NDArray[np.intp]
    step: Array


class Suspicion(NamedTuple):
    """A possible `cause`, in the words of the corrections that are tried (`repairs.Repair`), and the `sentence` that
    says what to do."""

    cause: str
    sentence: str


def nothing(machine: Machine) -> SignalHistory:
    """The history before any sample."""
    size = len(machine.signals)
    none = np.zeros(size, dtype=np.intp)
    return SignalHistory(np.zeros((0, size)), none, none, np.full(size, np.inf))


def gathered(model: Model, before: SignalHistory, values: Array, *, joins: bool) -> SignalHistory:
    """The history `before` with further samples (T, S); `joins`: they follow the last ones without a gap."""
    most = int(KEPT_S * model.filters.rate_hz)
    kept = (np.concatenate([before.kept, values]) if joins else values)[-most:]
    last = before.kept[-1:] if joins else before.kept[:0]
    change = np.abs(np.diff(np.concatenate([last, values]), axis=0))
    equal = np.logical_and(change == 0.0, _ought_to_change(model, values)[-len(change) :])
    repeated, longest = _runs(equal, before.repeated if joins else np.zeros_like(before.repeated))
    step = np.min(np.where(change > 0.0, change, np.inf), axis=0, initial=np.inf)
    return SignalHistory(kept, repeated, np.maximum(before.longest, longest), np.minimum(before.step, step))


def _runs(equal: NDArray[np.bool_], carried: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Length (S,) of the run of true values (T, S) at the end, and of the longest run; `carried` (S,): length of the
    run at the end of the samples before."""
    if not len(equal):
        return carried, carried
    count = np.arange(1, len(equal) + 1)[:, None]
    broken = np.maximum.accumulate(np.where(equal, 0, count), axis=0)
    run = count - broken + np.where(broken == 0, carried, 0)
    return run[-1], run.max(axis=0)


def _ought_to_change(model: Model, values: Array) -> NDArray[np.bool_]:
    """Whether each signal should change at each sample (T, S): a pressure while a joint of its own cylinder moves, an
    angle or length while any joint moves."""
    machine, window = model.machine, int(WINDOW_S * model.filters.rate_hz)
    angle = model.channels.read(values)[:, : machine.size]
    turns = np.zeros(angle.shape, dtype=bool)
    turns[window:] = np.abs(angle[window:] - angle[:-window]) > TURNING * WINDOW_S
    ought = np.zeros(values.shape, dtype=bool)
    for k, signal in enumerate(machine.signals):
        if signal.kind in PRESSURES:
            ought[:, k] = np.any(turns[:, list(machine.spans[signal.index])], axis=1)
        elif signal.kind in PLACES:
            ought[:, k] = np.any(turns, axis=1)
    return ought


def frozen_pressure(model: Model, evidence: SignalHistory) -> str | None:
    """One sentence when a pressure did not change for FROZEN_S although its cylinder moved, else None."""
    for k, signal in enumerate(model.machine.signals):
        seconds = evidence.longest[k] / model.filters.rate_hz
        if signal.kind in PRESSURES and seconds >= FROZEN_S:
            return (
                f"{signal.name} repeated one value for {seconds:.1f} s while its cylinder moved: the sensor is frozen; "
                "check it and its cable, then start again"
            )
    return None


def misplaced(model: Model, kept: Array) -> str | None:
    """One sentence when the inertial sensor cannot lie as the file says, by the samples `kept` (K, S); else None."""
    if not model.channels.inertial or len(kept) <= model.settle_steps:
        return None
    return _off_axis(model, kept) or _backwards(model, kept)


def _inertial_names(model: Model) -> list[str]:
    """Of rate, forward and upward acceleration."""
    return [next(s.name for s in model.machine.signals if s.kind is kind) for kind in INERTIAL]


def _off_axis(model: Model, kept: Array) -> str | None:
    channels = model.channels.read(kept).mean(axis=0)
    forward, upward = channels[model.channels.forces.stop + 1 : model.channels.forces.stop + 3].tolist()
    pitch, roll = channels[-3], channels[-2]
    gravity = model.machine.gravity * np.cos(roll) * np.exp(1j * pitch)
    expected = complex(gravity.imag, gravity.real)
    ratio = complex(forward, upward) / expected
    if abs(abs(ratio) - 1.0) < EXACT and abs(np.angle(ratio)) < ALIGNED:
        return None
    _, x, z = _inertial_names(model)
    return (
        f"{x} and {z} are {forward:.2f} and {upward:.2f} m/s^2 on average, but at this tilt {expected.real:.2f} and "
        f"{expected.imag:.2f}: the inertial sensor lies on another axis; mount it with x forward and z up, or correct "
        "object and sign of both entries, then start again"
    )


def _backwards(model: Model, kept: Array) -> str | None:
    if not any(s.kind is Kind.PITCH for s in model.machine.signals):
        return None
    turning = model.channels.turning(kept)[model.settle_steps :]
    gyro = model.channels.read(kept)[1 + model.settle_steps :, model.channels.forces.stop]
    if np.sqrt(np.mean(turning**2)) < ROCKS or turning @ gyro >= 0.0:
        return None
    return f"{_inertial_names(model)[0]} counts against the pitch: correct the sign of its scale (nose up is positive)"


def misfit(data: Factors, row_error: Array) -> float:
    """Share of the torque that a fit with `row_error` (R,) [N m] leaves unexplained: rms over the measured torques;
    infinite when none was measured."""
    samples = np.sum(data.samples, axis=0)
    seen = samples > 0
    size = np.sqrt(np.sum(data.triangle[..., -1] ** 2, axis=(0, 2))[seen] / samples[seen])
    return float(np.sqrt(np.mean((row_error[seen] / np.maximum(size, 1e-9)) ** 2))) if np.any(seen) else np.inf


def miswired(model: Model, evidence: SignalHistory) -> Suspicion | None:
    """For a recording that does not fit: what to do when an exchange of two sensors makes it fit, or when an angle or
    length sensor is frozen; else None."""
    if len(evidence.kept) < SHORT_S * model.filters.rate_hz:
        return None
    return _exchanged(model, evidence.kept) or _frozen_place(model, evidence)


def _exchanged(model: Model, kept: Array) -> Suspicion | None:
    there, samples = _misfit_of(model, kept)
    if there < MISFIT:
        return None
    read = Unwrapping(model.machine).of  # exchanged angles have other whole turns
    tried = [(*_misfit_of(model, read(swapped(kept, pair))), pair) for pair in exchanges(model.machine)]
    fitting = [(left, pair) for left, count, pair in tried if count > AS_MANY * samples and left < BETTER * there]
    if not fitting:
        return None
    left, pair = min(fitting)
    first, second = (" and ".join(model.machine.signals[k].name for k in part) for part in pair)
    return Suspicion(
        f"{first} exchanged with {second}",
        f"{first} must change places with {second}: the other way round, the unexplained torque falls from "
        f"{100 * there:.0f} to {100 * left:.1f} %; exchange their cables, or their entries in the machine file",
    )


def _misfit_of(model: Model, values: Array) -> tuple[float, float]:
    """(Misfit, number of usable samples) of a stretch of samples (T, S) fitted by itself."""
    data = chosen(observed_factors(model, [values]), list(range(len(model.parameters))))
    samples = np.sum(data.samples, axis=0)
    if not np.any(samples):
        return np.inf, 0.0
    size = np.sqrt(np.sum(data.triangle[..., -1] ** 2, axis=(0, 2)) / np.maximum(samples, 1.0))
    left = misfit(data, least_squares(data, MISFIT * size + 1.0, model.prior).row_error)
    return left, float(np.sum(samples))


def swapped(values: Array, pair: Exchange) -> Array:
    """Samples (T, S) with the signals of `pair` exchanged."""
    first, second = (list(part) for part in pair)
    exchanged = values.copy()
    exchanged[:, first + second] = values[:, second + first]
    return exchanged


def exchanges(machine: Machine) -> Iterator[Exchange]:
    """Exchanges that are tried: head and rod side of a cylinder, the angle or length sensors of two joints, all
    pressures of two cylinders."""
    where = {(s.kind, s.index): k for k, s in enumerate(machine.signals)}
    for c in range(len(machine.cylinders)):
        if all((kind, c) in where for kind in PRESSURES):
            yield (where[PRESSURES[0], c],), (where[PRESSURES[1], c],)
    places = [k for k, s in enumerate(machine.signals) if s.kind in PLACES]
    yield from (((a,), (b,)) for a, b in combinations(places, 2))
    cylinders = [
        tuple(where[kind, c] for kind in PRESSURES if (kind, c) in where) for c in range(len(machine.cylinders))
    ]
    yield from ((a, b) for a, b in combinations(cylinders, 2) if len(a) == len(b) > 0)


def _frozen_place(model: Model, evidence: SignalHistory) -> Suspicion | None:
    for k, signal in enumerate(model.machine.signals):
        seconds = evidence.longest[k] / model.filters.rate_hz
        shaky = signal.standard_error >= 0.5 * evidence.step[k] or not np.isfinite(evidence.step[k])
        if signal.kind in PLACES and shaky and seconds >= STILL_S:
            return Suspicion(
                FROZEN,
                f"{signal.name} showed exactly one value for {seconds:.0f} s of motion, and the forces do not fit it: "
                "the sensor is frozen; check it and its cable, then start again",
            )
    return None
