"""The rows of one joint beside what it does there: what the residual might be a function of."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.problem import Seen
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array

MOVING = 0.01  # m/s, where a cylinder is half certain of its direction


class Track(NamedTuple):
    """Rows (T,) of one joint in all recordings: residual `left` [N m], the joint's `position` [rad], `speed` [m/s] of
    its cylinder, all cylinders' forces `loads` (T, C) [N], `time` [s] since its recording began, `reversal` [s] since
    its cylinder last turned back, `turning` [rad/s] of the base, the number of the `recording`; `own`: which of the
    cylinders is its own."""

    left: Array
    position: Array
    speed: Array
    loads: Array
    time: Array
    reversal: Array
    turning: Array
    recording: NDArray[np.int_]
    own: int

    def parts(self, length_s: float) -> NDArray[np.int_]:
        """Number (T,) of the span of time that a row belongs to."""
        part = np.floor(self.time / length_s).astype(np.int64)
        return np.unique(np.stack([self.recording, part], axis=1), axis=0, return_inverse=True)[1].ravel()


def track(model: Model, group: Sequence[Seen], left: Sequence[Array], r: int) -> Track:
    """The usable rows of measured joint r, the residuals `left` (T, R) of stretches given."""
    own, cylinders = model.acting[r][0], len(model.machine.cylinders)
    names = list(dict.fromkeys(seen.recorded.name for seen in group))
    begins = {seen.recorded.name: seen.recorded.begins for seen in reversed(group)}
    parts = [
        _rows(seen, e[:, r], (model.machine.rows[r], own), begins[seen.recorded.name], names.index(seen.recorded.name))
        for seen, e in zip(group, left, strict=True)
    ]
    if not parts:
        none, number = np.zeros(0), np.zeros(0, dtype=np.int64)
        return Track(none, none, none, np.zeros((0, cylinders)), none, none, none, number, own)
    columns = {name: np.concatenate([getattr(part, name) for part in parts]) for name in Track._fields[:-1]}
    return Track(**columns, own=own)


def _rows(seen: Seen, left: Array, place: tuple[int, int], begins: float, number: int) -> Track:
    """Of one stretch; `place`: the joint and its cylinder."""
    rows, good = seen.rows, np.isfinite(left)
    joint, own = place
    speed = rows.speed[:, own]
    return Track(
        left[good],
        rows.posture[good, joint],
        speed[good],
        rows.force[good],
        rows.t[good] - begins,
        _since(speed, rows.t)[good],
        rows.turning[good],
        np.full(int(np.sum(good)), number),
        own,
    )


def _since(speed: Array, t: Array) -> Array:
    """Seconds (T,) since a cylinder last turned back, or since the stretch began."""
    number, moves = np.arange(len(t)), np.abs(speed) > MOVING
    last = np.maximum.accumulate(np.where(moves, number, 0))
    way = np.where(moves[last], np.sign(speed[last]), 0.0)
    turned = np.maximum.accumulate(np.where(np.diff(way, prepend=way[:1]) != 0.0, number, 0))
    return np.asarray(t - t[turned])
