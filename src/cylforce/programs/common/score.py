"""Scores of a simulated run: booked weights and tip forces beside the simulator's truth file."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.files.truth import TruthTable
from cylforce.signals.estimate import Array, Booking, Estimate
from cylforce.signals.units import STANDARD_GRAVITY
from cylforce.simulation.trajectory import Phase

SMALLEST_FORCE = 10e3  # N: below it a relative error has no meaning


class CycleScore(NamedTuple):
    """Score of one cycle.

    true_kg:           load in the bucket [kg]
    estimated_kg:      booked load [kg]; None: not booked
    standard_error_kg: standard error of the booking [kg]; None: not booked
    """

    true_kg: float
    estimated_kg: float | None
    standard_error_kg: float | None


class ForceScore(NamedTuple):
    """Errors of the tip force while digging, above 10 kN.

    rms_n:             of the error vector [N]
    p95_relative:      95th percentile of the error vector over the magnitude
    p95_magnitude:     95th percentile of the magnitude's error over the magnitude
    p95_direction_deg: 95th percentile of the angle between the vectors [deg]
    published:         share of the samples with a published force
    samples:           their number
    """

    rms_n: float
    p95_relative: float
    p95_magnitude: float
    p95_direction_deg: float
    published: float
    samples: int


def score_cycles(truth: TruthTable, bookings: Sequence[Booking]) -> list[CycleScore]:
    """Return the score of each cycle; a booking belongs to the last cycle that began to dump before it."""
    cycle, mass = truth.columns["cycle"].astype(int), truth.columns["mass"]
    dumping = truth.columns["phase"] == Phase.DUMP
    starts = {k: int(truth.t_us[dumping & (cycle == k)].min()) for k in np.unique(cycle[dumping]) if k > 0}
    booked: dict[int, Booking] = {}
    for booking in bookings:
        before = [k for k, start in starts.items() if start <= booking.t_us]
        if before:
            booked[max(before)] = booking
    return [_cycle(float(mass[cycle == k].max()), booked.get(k)) for k in sorted(starts)]


def _cycle(true_kg: float, booking: Booking | None) -> CycleScore:
    if booking is None:
        return CycleScore(true_kg, None, None)
    return CycleScore(true_kg, booking.mass, booking.standard_error)


def true_force(truth: TruthTable) -> Array:
    """Return the force (T, 2) [N] on the tool, soil and weight of the material together, unfiltered.

    Forces on one body have the same resultant wherever they act: reduced to the tooth line they keep it.
    """
    weight = -truth.columns["mass"] * STANDARD_GRAVITY * np.cos(truth.columns["roll"])
    return np.stack([truth.columns["soil_x"], truth.columns["soil_z"] + weight], axis=-1)


def score_force(truth: TruthTable, estimates: Sequence[Estimate]) -> ForceScore:
    """Return the errors of the force, compared with the truth at the time of publication."""
    wanted = true_force(truth)
    row = _nearest(truth.t_us, np.array([e.t_us for e in estimates]))
    digging = (truth.columns["phase"][row] == Phase.DIG) & (np.hypot(*wanted[row].T) > SMALLEST_FORCE)
    found = np.array([(e.force.x.value, e.force.z.value) for e in estimates])[digging]
    return _force_score(found, wanted[row][digging])


def _force_score(found: Array, wanted: Array) -> ForceScore:
    good = np.all(np.isfinite(found), axis=1)
    if not np.any(good):
        return ForceScore(*(float("nan"),) * 4, 0.0, len(good))
    found, wanted = found[good], wanted[good]
    size, error = np.hypot(*wanted.T), np.hypot(*(found - wanted).T)
    turn = np.degrees(np.abs(np.angle((found @ (1, 1j)) / (wanted @ (1, 1j)))))
    return ForceScore(
        rms_n=float(np.sqrt(np.mean(error**2))),
        p95_relative=float(np.percentile(error / size, 95)),
        p95_magnitude=float(np.percentile(np.abs(np.hypot(*found.T) - size) / size, 95)),
        p95_direction_deg=float(np.percentile(turn, 95)),
        published=float(np.mean(good)),
        samples=len(good),
    )


def _nearest(times: NDArray[np.int64], asked: NDArray[np.int64]) -> NDArray[np.intp]:
    after = np.clip(np.searchsorted(times, asked), 1, len(times) - 1)
    return after - (asked - times[after - 1] < times[after] - asked)
