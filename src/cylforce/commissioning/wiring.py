"""Check on raw samples whether every sensor works and is connected as in the machine file.

Signs of a fault: values that repeat although they must change, an inertial sensor on another axis, and exchanges of two
sensors with which the recording would fit.
"""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.batch import converged
from cylforce.estimation.blocks import Factors, chosen
from cylforce.estimation.model import Model
from cylforce.estimation.observation import observed_factors
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.unwrapping import Unwrapping
from cylforce.signals.estimate import Array
from cylforce.signals.kinds import INERTIAL, Kind
from cylforce.signals.units import DEGREE

KEPT_S = 40.0  # s of the latest samples that are kept for trying exchanges; chosen
SHORT_S = 8.0  # s of samples below which no exchange is tried; chosen
FROZEN_S = 1.0  # s of one and the same pressure while its cylinder moves: the sensor is frozen; chosen
STILL_S = 5.0  # s of one and the same angle, without even noise, while a joint moves: the sensor is frozen; chosen
TURNING = 0.01  # rad/s, rate from which on a joint counts as moving; chosen
WINDOW_S = 0.25  # s over which that rate is measured; chosen
MISFIT = 0.03  # unexplained share of the torque beyond which a sensor is suspected; chosen
BETTER = 0.25  # largest misfit after the right exchange, times the misfit before it; chosen
STILL_USABLE = 0.8  # share of the usable samples that must remain usable after the right exchange; chosen

# Largest error of direction [rad] and of size of the measured gravity. Mounted by hand a sensor is within 2 to 3
# degrees, and accelerometers are within 2 to 3 % of gravity; the base's own acceleration averages out.
ALIGNED, EXACT = 6.0 * DEGREE, 0.06
ROCKS = 0.01  # rad/s rms of the pitch rate from which on its sign is certain: twenty times the sensors' noise

FROZEN = "frozen"  # cause of a suspicion for which there is no other explanation

PLACES = (Kind.JOINT_ANGLE, Kind.LINK_INCLINATION, Kind.CYLINDER_LENGTH)  # signals that give a joint's position
PRESSURES = (Kind.HEAD_PRESSURE, Kind.ROD_PRESSURE)
Exchange = tuple[tuple[int, ...], tuple[int, ...]]  # numbers of the signals of both sides of an exchange


class SignalHistory(NamedTuple):
    """History of the raw signals.

    kept: (K, S) latest samples [SI]
    repeated: (S,) number of samples up to the last one for which the signal has repeated one value although it should
        change
    longest: (S,) longest such run of samples so far
    step: (S,) smallest change from one sample to the next other than zero [SI]; infinite: it never changed
    """

    kept: Array
    repeated: NDArray[np.intp]
    longest: NDArray[np.intp]
    step: Array


class Suspicion(NamedTuple):
    """A possible cause of a misfit.

    cause: name of the cause, as of a correction (`repairs.Repair.cause`)
    sentence: fault and cure
    """

    cause: str
    sentence: str


def empty_history(machine: Machine) -> SignalHistory:
    """Return the history before any sample."""
    size = len(machine.signals)
    none = np.zeros(size, dtype=np.intp)
    return SignalHistory(np.zeros((0, size)), none, none, np.full(size, np.inf))


def extended_history(model: Model, before: SignalHistory, values: Array, *, joins: bool) -> SignalHistory:
    """Return a history with further samples.

    Only the latest samples are kept (KEPT_S). Without `joins` they are the new ones only, and runs begin anew.

    before: the history so far
    values: (T, S) further samples [SI]
    joins: whether the samples follow the last ones without a gap
    """
    most = int(KEPT_S * model.filters.rate_hz)
    kept = (np.concatenate([before.kept, values]) if joins else values)[-most:]
    last = before.kept[-1:] if joins else before.kept[:0]
    change = np.abs(np.diff(np.concatenate([last, values]), axis=0))
    equal = np.logical_and(change == 0.0, _ought_to_change(model, values)[-len(change) :])
    repeated, longest = _runs(equal, before.repeated if joins else np.zeros_like(before.repeated))
    step = np.min(np.where(change > 0.0, change, np.inf), axis=0, initial=np.inf)
    return SignalHistory(kept, repeated, np.maximum(before.longest, longest), np.minimum(before.step, step))


def _runs(equal: NDArray[np.bool_], carried: NDArray[np.intp]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the length (S,) of the run of true values at the end, and of the longest run.

    equal: (T, S) whether a value repeats the last one
    carried: (S,) length of the run at the end of the samples before
    """
    if not len(equal):
        return carried, carried
    count = np.arange(1, len(equal) + 1)[:, None]
    broken = np.maximum.accumulate(np.where(equal, 0, count), axis=0)
    run = count - broken + np.where(broken == 0, carried, 0)
    return run[-1], run.max(axis=0)


def _ought_to_change(model: Model, values: Array) -> NDArray[np.bool_]:
    """Return whether each signal should change at each sample (T, S).

    A pressure should change while a joint of its own cylinder moves, an angle or length while any joint moves.
    """
    machine, window = model.machine, int(WINDOW_S * model.filters.rate_hz)
    angle = model.channels.read(values)[:, : machine.size]
    moves = np.zeros(angle.shape, dtype=bool)
    moves[window:] = np.abs(angle[window:] - angle[:-window]) > TURNING * WINDOW_S
    ought = np.zeros(values.shape, dtype=bool)
    for k, signal in enumerate(machine.signals):
        if signal.kind in PRESSURES:
            ought[:, k] = np.any(moves[:, list(machine.spans[signal.index])], axis=1)
        elif signal.kind in PLACES:
            ought[:, k] = np.any(moves, axis=1)
    return ought


def frozen_pressure(model: Model, evidence: SignalHistory) -> str | None:
    """Return one sentence when a pressure did not change for FROZEN_S although its cylinder moved, else None."""
    for k, signal in enumerate(model.machine.signals):
        seconds = evidence.longest[k] / model.filters.rate_hz
        if signal.kind in PRESSURES and seconds >= FROZEN_S:
            return (
                f"{signal.name} repeated one value for {seconds:.1f} s while its cylinder moved: the sensor is frozen; "
                "check it and its cable, then start again"
            )
    return None


def misplaced_inertial_sensor(model: Model, kept: Array) -> str | None:
    """Return one sentence when the inertial sensor cannot be mounted as in the machine file, else None.

    kept: latest samples (K, S) [SI]
    """
    if not model.channels.inertial or len(kept) <= model.settle_steps:
        return None
    return _off_axis(model, kept) or _backwards(model, kept)


def _inertial_names(model: Model) -> list[str]:
    """Return the names of the signals of rate, forward and upward acceleration."""
    return [next(s.name for s in model.machine.signals if s.kind is kind) for kind in INERTIAL]


def _off_axis(model: Model, kept: Array) -> str | None:
    """Return a sentence when the mean acceleration is not gravity at the measured tilt, else None.

    kept: latest samples (K, S) [SI]
    """
    channels = model.channels.read(kept).mean(axis=0)
    forward, upward = channels[model.channels.forces.stop + 1 : model.channels.forces.stop + 3].tolist()
    pitch, roll = channels[-3], channels[-2]
    gravity = model.machine.gravity * np.cos(roll) * np.exp(1j * pitch)
    expected = complex(gravity.imag, gravity.real)
    ratio = complex(forward, upward) / expected
    if abs(abs(ratio) - 1.0) < EXACT and abs(np.angle(ratio)) < ALIGNED:
        return None
    forward_name, upward_name = _inertial_names(model)[1:]
    return (
        f"{forward_name} and {upward_name} are {forward:.2f} and {upward:.2f} m/s^2 on average, but at this tilt "
        f"{expected.real:.2f} and {expected.imag:.2f}: the inertial sensor lies on another axis; mount it with x "
        "forward and z up, or correct object and sign of both entries, then start again"
    )


def _backwards(model: Model, kept: Array) -> str | None:
    """Return a sentence when the gyro's rate has the opposite sign of the measured pitch's rate, else None.

    kept: latest samples (K, S) [SI]
    """
    if not any(s.kind is Kind.PITCH for s in model.machine.signals):
        return None
    pitch_rate = model.channels.turning(kept)[model.settle_steps :]
    gyro = model.channels.read(kept)[1 + model.settle_steps :, model.channels.forces.stop]
    if np.sqrt(np.mean(pitch_rate**2)) < ROCKS or pitch_rate @ gyro >= 0.0:
        return None
    return f"{_inertial_names(model)[0]} counts against the pitch: correct the sign of its scale (nose up is positive)"


def misfit(data: Factors, row_error: Array) -> float:
    """Return the share of the torque that a fit does not explain: rms residual over rms torque; infinite without any.

    It is the rms over those measured torques that have fitted rows.

    data: factors of the fitted rows
    row_error: (R,) rms residual of the fit [N m]
    """
    samples = np.sum(data.samples, axis=0)
    measured = samples > 0
    size = np.sqrt(np.sum(data.triangle[..., -1] ** 2, axis=(0, 2))[measured] / samples[measured])
    return float(np.sqrt(np.mean((row_error[measured] / np.maximum(size, 1e-9)) ** 2))) if np.any(measured) else np.inf


def wiring_fault(model: Model, evidence: SignalHistory) -> Suspicion | None:
    """Return the wiring fault that explains a recording that does not fit, else None.

    The fault is an exchange of two sensors with which the recording fits, or a frozen angle or length sensor. None is
    returned, too, when there are too few samples (SHORT_S).
    """
    if len(evidence.kept) < SHORT_S * model.filters.rate_hz:
        return None
    return _exchanged(model, evidence.kept) or _frozen_place(model, evidence)


def _exchanged(model: Model, kept: Array) -> Suspicion | None:
    """Return the exchange with which the samples (K, S) [SI] fit best; None when none is clearly better.

    None is returned, too, when they fit as they are (MISFIT). Clearly better: the misfit falls below BETTER times that
    without an exchange, and most samples remain usable (STILL_USABLE).
    """
    before, samples = _misfit_of(model, kept)
    if before < MISFIT:
        return None
    unwrap = Unwrapping(model.machine).of  # exchanged angles have other whole turns
    tried = [(*_misfit_of(model, unwrap(swapped(kept, pair))), pair) for pair in exchanges(model.machine)]
    fitting = [
        (after, pair) for after, count, pair in tried if count > STILL_USABLE * samples and after < BETTER * before
    ]
    if not fitting:
        return None
    after, pair = min(fitting)
    first, second = (" and ".join(model.machine.signals[k].name for k in part) for part in pair)
    return Suspicion(
        f"{first} exchanged with {second}",
        f"{first} must change places with {second}: the other way round, the unexplained torque falls from "
        f"{100 * before:.0f} to {100 * after:.1f} %; exchange their cables, or their entries in the machine file",
    )


def _misfit_of(model: Model, values: Array) -> tuple[float, float]:
    """Return misfit and number of fitted rows, of all measured torques together, of a stretch of samples (T, S) [SI].

    It is fitted by itself. Infinite and 0 without a fitted row. Raises TooShortError for a stretch that is too short.
    """
    data = chosen(observed_factors(model, [values]), list(range(len(model.parameters))))
    samples = np.sum(data.samples, axis=0)
    if not np.any(samples):
        return np.inf, 0.0
    size = np.sqrt(np.sum(data.triangle[..., -1] ** 2, axis=(0, 2)) / np.maximum(samples, 1.0))
    row_error = converged(data, MISFIT * size + 1.0, model.prior).row_error
    return misfit(data, row_error), float(np.sum(samples))


def swapped(values: Array, pair: Exchange) -> Array:
    """Return samples with the signals of a pair exchanged.

    values: (T, S) samples, not changed
    pair: numbers of the signals on both sides, as many on each
    """
    first, second = (list(part) for part in pair)
    exchanged = values.copy()
    exchanged[:, first + second] = values[:, second + first]
    return exchanged


def exchanges(machine: Machine) -> Iterator[Exchange]:
    """Yield the exchanges that are tried.

    They are head and rod side of a cylinder, the angle or length sensors of two joints, all pressures of two cylinders.
    """
    number = {(s.kind, s.index): k for k, s in enumerate(machine.signals)}
    for c in range(len(machine.cylinders)):
        if all((kind, c) in number for kind in PRESSURES):
            yield (number[PRESSURES[0], c],), (number[PRESSURES[1], c],)
    positions = [k for k, s in enumerate(machine.signals) if s.kind in PLACES]
    yield from (((a,), (b,)) for a, b in combinations(positions, 2))
    cylinders = [
        tuple(number[kind, c] for kind in PRESSURES if (kind, c) in number) for c in range(len(machine.cylinders))
    ]
    yield from ((a, b) for a, b in combinations(cylinders, 2) if len(a) == len(b) > 0)


def _frozen_place(model: Model, evidence: SignalHistory) -> Suspicion | None:
    """Return a suspicion when an angle or length repeated one value for STILL_S although its noise should show.

    Noise shows where the sensor's standard error is at least half of the smallest change seen.
    """
    for k, signal in enumerate(model.machine.signals):
        seconds = evidence.longest[k] / model.filters.rate_hz
        noisy = signal.standard_error >= 0.5 * evidence.step[k] or not np.isfinite(evidence.step[k])
        if signal.kind in PLACES and noisy and seconds >= STILL_S:
            return Suspicion(
                FROZEN,
                f"{signal.name} showed exactly one value for {seconds:.0f} s of motion, and the forces do not fit it: "
                "the sensor is frozen; check it and its cable, then start again",
            )
    return None
