"""How large an effect is, in standard errors of an ideal detector that knows the truth.

The case and its twin (the clean machine, same motion asked for, same noise) differ by the effect alone. Both are turned
into joint torques by the estimator's geometry and less what the clean machine's parameters explain; the difference,
less what base parameters shared with the references can absorb, is the effect's signal."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.model import Model
from cylforce.estimation.observation import observe
from cylforce.settings.machine_file import Loaded

Array = NDArray[np.float64]
EVERY = 5  # rows of the filtered torques, which hold nothing above 10 Hz
BLOCK = 60  # rows: 3 s
LAWS = ("coulomb", "viscous", "directional")
ABSORBED = 1e-4  # share of a column that its neighbours do not explain, below which it is left out
DETECTED = 5.0  # sigma


@dataclass(frozen=True)
class Rows:
    """Torques (T, R) and columns (T, R, P) of a recording, zero where not usable; `load` [kg] or 0; `quiet` (T,): 1
    where nothing unknown acts, else 0."""

    torque: Array
    columns: Array
    load: float
    quiet: Array


class Floor:
    """The residual of the clean machine on its references and its field recordings."""

    def __init__(self, loaded: Loaded, load_kg: float) -> None:
        service = loaded.service
        self.model = Model(service.machine, service.filters, LAWS)
        self.load_kg = load_kg

    def rows(self, name: str, values: Array, quiet: NDArray[np.bool_]) -> Rows:
        """Every fifth row of a recording (T, S)."""
        seen = observe(self.model, values)
        torque, columns = seen.torque[::EVERY], seen.columns[::EVERY]
        usable = np.isfinite(torque)
        return Rows(
            np.where(usable, torque, 0.0),
            np.where(usable[..., None], columns, 0.0),
            self.load_kg if "loaded" in name else 0.0,
            self._quiet(quiet, len(usable)),
        )

    def _quiet(self, quiet: NDArray[np.bool_], rows: int) -> Array:
        """Of the filtered rows, from that of the recording's."""
        at = np.clip(np.round(self.times(rows) * self.model.filters.rate_hz).astype(int), 0, len(quiet) - 1)
        return np.asarray(quiet[at], dtype=np.float64)

    def times(self, rows: int) -> Array:
        """When the rows of a recording are [s], from its begin."""
        steps = self.model.settle_steps + EVERY * np.arange(rows, dtype=np.float64)
        return np.asarray((steps - 0.5) / self.model.filters.rate_hz, dtype=np.float64)

    def designed(self, parts: list[Rows]) -> tuple[Array, Array]:
        """Columns (T, R, K) and torque (T, R) of several recordings: shared parameters, for each loaded one the
        place of its load; the known weight is subtracted."""
        loads = [k for k, part in enumerate(parts) if part.load]
        shared = parts[0].columns.shape[-1]
        width = shared + 3 * len(loads)
        columns, torques = [], []
        for k, part in enumerate(parts):
            whole = np.zeros((*part.torque.shape, width))
            whole[..., :shared] = part.columns
            torque = part.torque
            if part.load:
                carried = part.columns @ self.model.load
                first = shared + 3 * loads.index(k)
                whole[..., first : first + 3] = carried[..., 1:]
                torque = torque - part.load * carried[..., 0]
            columns.append(whole)
            torques.append(torque)
        return np.concatenate(columns), np.concatenate(torques)


@dataclass(frozen=True)
class Effect:
    """Signal and floor (T, R) [N m] over the field, and the floor's level (R,)."""

    signal: Array
    floor: Array
    level: Array

    @cached_property
    def sigmas(self) -> float:
        """Signal over the standard error of its score; the error from block scores, and from scores against the floor
        shifted in time: both know that the floor is correlated."""
        weighted = self.signal / self.level**2
        energy = float(np.sum(weighted * self.signal))
        scores = np.sum(weighted * self.floor, axis=1)
        blocks = np.add.reduceat(scores, np.arange(0, len(scores), BLOCK))
        shifted = sum(
            np.fft.rfft(weighted[:, r]).conj() * np.fft.rfft(self.floor[:, r]) for r in range(len(self.level))
        )
        moved = np.fft.irfft(shifted, len(scores))
        error = max(float(np.sum(blocks**2)), float(np.mean(moved**2)))
        return energy / np.sqrt(error) if error > 0.0 else 0.0


@dataclass(frozen=True)
class Comparison:
    """A case beside its twin, over the field (T, R): `difference` that the effect makes to the residual of the clean
    machine's parameters, NaN where either is unusable; that residual (`floor`), its `level` (R,), and the signal that
    is left of the difference when the base parameters have taken what they can."""

    difference: Array
    signal: Array
    floor: Array
    level: Array

    @property
    def effect(self) -> Effect:
        """Signal and floor."""
        return Effect(self.signal, self.floor, self.level)

    @property
    def added(self) -> float:
        """Rms torque that the effect adds, in noise floors, at the joint where it is largest; 0 at a joint without
        rows."""
        rows = np.maximum(np.isfinite(self.difference).sum(axis=0), 1)
        return float(np.max(np.sqrt(np.nansum(self.difference**2, axis=0) / rows) / self.level))

    @property
    def over_floor(self) -> float:
        """Rms residual with the effect, in noise floors, at the joint where it is largest: sqrt(1 + added^2), as floor
        and effect are uncorrelated."""
        return float(np.hypot(1.0, self.added))


def compared(floor: Floor, references: list[Rows], twin: list[Rows], case: list[Rows]) -> Comparison:
    """Parameters are fitted on references and twin, and refitted on references and case. The floor is that of the
    quiet rows: what is dug and lifted is the same in both, and no part of the difference."""
    columns, torque = floor.designed([*references, *twin])
    changed, felt = floor.designed([*references, *case])
    calm = np.concatenate([part.quiet for part in (*references, *twin)])[:, None]
    columns_there, torque_there, level = calm[..., None] * columns, calm * torque, np.ones(torque.shape[1])
    fit, left = np.zeros(columns.shape[-1]), torque
    for _ in range(2):
        fit = _fit(columns_there, torque_there, level)
        left = torque_there - columns_there @ fit
        level = np.sqrt(np.sum(left**2, axis=0) / np.maximum(np.sum(torque_there != 0.0, axis=0), 1)) + 1e-9
    both = (torque != 0.0) & (felt != 0.0)
    difference = np.where(both, felt - changed @ fit - (torque - columns @ fit), 0.0)
    basis = np.where(both[..., None], changed, 0.0)
    signal = difference - basis @ _fit(basis, difference, level)
    field = slice(sum(len(part.torque) for part in references), None)
    floor_there = left[field] / np.sqrt(max(float(np.mean(calm[field])), 1.0 / len(calm)))
    return Comparison(np.where(both, difference, np.nan)[field], signal[field], floor_there, level)


def explained(signal: Array, other: Array, level: Array) -> Array:
    """What another cause's signal (T, R), scaled, explains of a signal (T, R); rows weighted by their `level` (R,)."""
    return np.asarray(other * _fit(other[..., None], signal, level)[0])


def _fit(columns: Array, torque: Array, level: Array) -> Array:
    """Least squares with the rows' levels; columns without information get zero."""
    flat = (columns / level[:, None]).reshape(-1, columns.shape[-1])
    norm = np.linalg.norm(flat, axis=0)
    scale = 1.0 / np.where(norm > 0.0, norm, 1.0)
    gram = (flat * scale).T @ (flat * scale)
    right = (flat * scale).T @ (torque / level).reshape(-1)
    return np.asarray(np.linalg.lstsq(gram, right, rcond=ABSORBED**2)[0] * scale)
