"""What a residual does by itself: it swings with time at one frequency, or is there in few moments only."""

import numpy as np

from cylforce.diagnosis.track import Track
from cylforce.signals.estimate import Array

HERTZ = (0.3, 3.0)
STEP = 1.06  # from one frequency to the next
BESIDE = 7  # steps: there, what swings must be less
WINDOW_S = 8.0  # in which it has an amplitude and a phase of its own
LEAST = 40  # rows of a window
MOMENT_S = 1.0
FEW = 0.1  # of all moments


def swinging(track: Track) -> tuple[float, float]:
    """Mean square [N^2 m^2] that is at one frequency, more than at those beside it, and that frequency [Hz]."""
    part, hertz = track.parts(WINDOW_S), _hertz()
    here = [part == k for k in np.flatnonzero(np.bincount(part) >= LEAST)]
    gone = np.sum([_waves(track.time[k], track.left[k], hertz) for k in here], axis=0) if here else 0.0 * hertz
    middle = gone[BESIDE:-BESIDE]
    peak = np.minimum(middle - gone[: -2 * BESIDE], middle - gone[2 * BESIDE :])
    best = int(np.argmax(peak))
    return float(peak[best]) / max(len(track.left), 1), float(hertz[best + BESIDE])


def _hertz() -> Array:
    """Frequencies (F,), BESIDE of them beyond both ends."""
    count = round(np.log(HERTZ[1] / HERTZ[0]) / np.log(STEP))
    return np.asarray(HERTZ[0] * STEP ** np.arange(-BESIDE, count + 1 + BESIDE))


def _waves(t: Array, left: Array, hertz: Array) -> Array:
    """Energy (F,) that a wave of each frequency takes away from a window, a straight line taken off before."""
    basis = np.linalg.qr(np.stack([np.ones_like(t), t - t.mean()], axis=1))[0]
    angle = 2.0 * np.pi * hertz[:, None] * t
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    q = np.linalg.qr(waves - basis @ (basis.T @ waves))[0]
    return np.asarray(np.sum((q.transpose(0, 2, 1) @ left) ** 2, axis=1))


def moments(track: Track, floor: float) -> float:
    """Mean square [N^2 m^2] beyond the floor's that the worst tenth of all moments makes."""
    part = track.parts(MOMENT_S)
    above = np.bincount(part, track.left**2) - floor**2 * np.bincount(part)
    worst = np.sort(above)[::-1][: max(round(FEW * len(above)), 1)]
    return float(np.sum(worst)) / len(track.left)
