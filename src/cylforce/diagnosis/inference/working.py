"""A machine at work: loads of which nothing is known hang in the bucket, and while the teeth touch the ground nothing
can be told. A block of three seconds is either free of contact, then it counts, with a load of its own, or it is left
out: then it has a variance of its own. Which blocks these are is settled under every hypothesis anew."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.columns.statistics import White, blocked, polynomials
from cylforce.diagnosis.inference.asking import Asking
from cylforce.diagnosis.inference.discrepancy import DECAY, Moments, Scatter
from cylforce.diagnosis.inference.hypotheses import Hypothesis, Inference
from cylforce.diagnosis.numbers import HAPPENS
from cylforce.effects.fault import SHAPES
from cylforce.signals.estimate import Array

CARRIED = ("load.mass", "load.X", "load.Z", "load.J")
SLEW = tuple(f"slew.{k}" for k in range(SHAPES))
HEAVY = 4.0  # times an unusual change of a load: what may hang in the bucket
QUIET = 0.4  # of the blocks, with which the search begins: those in which least is left
ROUNDS = 4

Blocks = NDArray[np.bool_]


@dataclass(frozen=True)
class Work:
    """Recordings of work, and what the references show (`case`, whose sums are not used)."""

    question: Asking
    case: Inference

    @cached_property
    def _whites(self) -> list[White]:
        return self.question.whites(self.question.problem.faulty)

    @cached_property
    def _loads(self) -> Moments:
        found = self.question.moments(self.question.problem.faulty, (*CARRIED, *SLEW))
        size = np.concatenate([np.full(len(CARRIED), HEAVY), np.ones(len(SLEW))])
        return Moments(
            found.across * size[:, None], found.within * np.outer(size, size), found.waves * size, found.smooth
        )

    @cached_property
    def _rows(self) -> tuple[Array, Array, Array]:
        """Columns asked with what is left (B, BLOCK, R, K+1) in units of their spread, smooth shapes, and how many rows
        a block has (B,)."""
        unit = np.append(self.question.scene.spread, 1.0)
        own = [*self.question.own, -1]
        rows = np.concatenate([blocked(w.rows[..., own].astype(np.float64)) * unit for w in self._whites])
        usable = [blocked(w.good.astype(np.float64)) for w in self._whites]
        basis = np.concatenate([polynomials(good) for good in usable])
        return rows, basis, np.concatenate([good.sum(axis=(1, 2)) for good in usable])

    def energies(self, left: Array, noise: Scatter) -> Array:
        """What coefficients (K+1,) leave of every block (B,), weighed by the noise, a load of its own taken off."""
        rows, basis, _ = self._rows
        plain = np.einsum("btrk,k->btr", rows, left, optimize=True)
        along = np.einsum("btrk,btr->brk", basis, plain, optimize=True)
        smooth = noise.rho[:, None] ** 2 * DECAY
        share = smooth / (noise.v[:, None] ** 2 + smooth)
        each = np.sum(plain**2, axis=1) - np.sum(share * along**2, axis=2)
        across, precision, _ = self._loads.weighed(noise)
        pull = across @ left
        load = np.einsum("bi,bi->b", pull, np.linalg.solve(precision, pull[..., None])[..., 0])
        return np.asarray(np.maximum(np.sum(each / noise.v**2, axis=1) - load, 0.0))

    def free(self, left: Array, noise: Scatter) -> Blocks:
        """The blocks (B,) that are more probably free of contact than not."""
        with_all, alone = self._logs(left, noise)
        return np.asarray((self._rows[2] > 0.0) & (with_all >= alone))

    def apart(self, kept: Blocks, left: Array, noise: Scatter) -> float:
        """Log of the probability of the blocks that are not `kept` (B,), and of that these are they."""
        _, alone = self._logs(left, noise)
        out = (self._rows[2] > 0.0) & ~kept
        return float(np.sum(alone[out])) + float(np.sum(kept)) * float(np.log(1.0 - HAPPENS))

    def _logs(self, left: Array, noise: Scatter) -> tuple[Array, Array]:
        """Log of the probability of every block (B,) with the noise of all, and with a variance of its own."""
        count = self._rows[2]
        energy = np.maximum(self.energies(left, noise), 1e-9)
        scale = count * float(np.mean(np.log(noise.v)))
        own = np.sqrt(energy / np.maximum(count, 1.0))
        alone = -count * (np.log(np.maximum(own, 1.0)) + 0.5 * np.minimum(own, 1.0) ** 2) - scale
        return -0.5 * energy - scale + np.log(1.0 - HAPPENS), alone + np.log(HAPPENS)

    def idle(self) -> tuple[Hypothesis, Inference, Blocks]:
        """The machine in order, begun with the blocks in which least is left by the references' parameters, and with
        those that are free of contact by them: whichever is likelier in the end."""
        left, count = np.append(-self.case.mean, 1.0), self._rows[2]
        each = self.energies(left, self.case.usual) / np.maximum(count, 1.0)
        least = np.asarray((count > 0.0) & (each <= np.quantile(each[count > 0.0], QUIET)))
        free = self.free(left, self.case.usual)
        begun = [kept for kept in (least, free) if np.any(kept)]
        return max((self.hypothesis((), kept, self.case.usual) for kept in begun), key=lambda found: found[0].log)

    def on(self, kept: Blocks) -> Inference:
        """The question put to some blocks (B,)."""
        problem = self.question.problem
        recording = self.question.sums(problem.faulty, self.question.noisy.faulty, kept)
        return replace(self.case, sums=recording, moments=self._loads.only(kept), apart=0.0)

    def hypothesis(self, which: tuple[int, ...], kept: Blocks, noise: Scatter) -> tuple[Hypothesis, Inference, Blocks]:
        """A hypothesis with the blocks in which it holds, from those `kept` at first."""
        best = None
        for _ in range(ROUNDS):
            case = self.on(kept)
            found = case.hypothesis(which, noise)
            left = case.under(which, case.state(found.noise))[2]
            again = self.free(left, self.case.usual)
            if not np.any(again):
                break
            rest = self.apart(kept, left, self.case.usual)
            best = found._replace(log=found.log + rest), replace(case, apart=rest), kept
            if np.array_equal(again, kept):
                break
            kept = again
        if best is None:
            case = self.on(kept)
            return case.hypothesis(which, noise)._replace(log=-np.inf), case, kept
        found, case, kept = best
        return case.likeliest(which, found.noise), case, kept


class AtWork(NamedTuple):
    """Recordings of `work` of which only the blocks `kept` (B,) count: with these the `case`, and the machine in order,
    `idle`."""

    work: Work
    idle: Hypothesis
    case: Inference
    kept: Blocks

    @property
    def share(self) -> float:
        """Of the blocks that do not count."""
        return float(np.mean(~self.kept))
