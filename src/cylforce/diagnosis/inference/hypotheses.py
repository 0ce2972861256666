"""The probability model: what is left of a joint's torque is the machine's parameters and its everyday differences,
effects of the library, a smooth discrepancy of each joint, and noise.

    y = X (m + g) + X_h s + Q d + e,   g ~ N(0, C),   d ~ N(0, rho^2 w_k),   e ~ N(0, v^2)

with mean m and covariance C from the references and everyday differences, whose size is maximised under the promising
hypotheses, sizes s of a hypothesis h log-uniform over the plausible range, and level rho and scale v of each joint
maximised under every hypothesis, with a prior around what the references show and a flat tail: the tail is what is
unknown."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dpotri

from cylforce.diagnosis.inference.discrepancy import Moments, Scatter, Sums, log_prior, settled_noise
from cylforce.diagnosis.inference.sizes import WIDE, Fitted, Marginal, Terms, beside, log_size, positive
from cylforce.diagnosis.numbers import HOLDS, SAME, SIGMAS, STEADY
from cylforce.signals.estimate import Array

ROUNDS = 12  # at most, in which noise and what is left are told in turns
REMEMBERED = 16  # states under a noise: each takes some megabytes
NONE = 1e-12  # of a column's spread, squared: no everyday difference
SINGLE = float(np.finfo(np.float32).eps)  # of an energy, which is the most that is lost where a load is taken off
ROUNDING = 1e-9  # of a Gram matrix, by which single precision may make it negative


class Hypothesis(NamedTuple):
    """Forms of a scene by number, the logarithm of their probability with the recording, the noise under them, their
    sizes (M,) and standard errors (M,) [of the prior spread], what they leave at the worst joint, of the floor, and by
    how much they are less probable because noise in column and residual is not told exactly, `doubt`."""

    which: tuple[int, ...]
    log: float
    noise: Scatter
    sizes: Array
    errors: Array
    rest: float
    doubt: float = 0.0


def counted(rest: float) -> float:
    """The share of evidence that counts beside what is left, of the floor (rms): beyond what references leave of each
    other it is no noise, but stays what it is for HOLDS rows, which tell no more than one."""
    beyond = max(1.0 - (1.0 + SAME) / max(rest, 1.0) ** 2, 0.0)
    return float(1.0 / (1.0 + (HOLDS - 1.0) * beyond))


def _nothing(*_: object) -> float:
    return 0.0


@dataclass(frozen=True)
class Inference:
    """A recording, and what the machine's parameters are beforehand: `mean` (K,) and `covariance` (K, K) by the
    references, and `everyday` differences (K,), standard deviations; `moments`: what may happen in single blocks;
    `taken`: sizes (M,) [of the prior spread] of forms that are taken out of the recording already; `told`: what else
    speaks for a form with sizes (M,) in their units [nats]; `apart`: the log of the probability of what is left out."""

    scene: Terms
    sums: Sums
    usual: Scatter
    mean: Array
    covariance: Array
    everyday: Array
    moments: Moments | None = None
    taken: Mapping[int, Array] = field(default_factory=dict)
    told: Callable[[int, Array], float] = _nothing
    apart: float = 0.0

    def uncertain(self, fields: Sequence[int] = ()) -> float:
        """How uncertain the references leave the torques of the recording at the worst joint, of the floor (rms), but
        for columns that only the field itself tells, such as where a load hangs."""
        told = np.delete(np.arange(len(self.mean)), list(fields))
        known = np.ix_(np.arange(len(self.sums.rows)), told, told)
        energy = np.einsum("rij,ij->r", self.sums.whole[known], self.covariance[np.ix_(told, told)])
        return float(np.sqrt(np.max(np.maximum(energy, 0.0) / np.maximum(self.sums.rows, 1.0))))

    def unsure(self, groups: Iterable[Sequence[int]]) -> "Inference":
        """The same where what the references tell of each group of columns, all together, is as uncertain as it is
        large."""
        covariance = self.covariance.copy()
        for own in groups:
            covariance[np.ix_(own, own)] += np.outer(self.mean[own], self.mean[own])
        return replace(self, covariance=covariance)

    @cached_property
    def _precisions(self) -> dict[float, tuple[Array, float]]:
        return {}

    def precision(self, noise: Scatter) -> tuple[Array, float]:
        """Of the parameters beforehand, with the everyday differences of a noise (K, K), and the log determinant of its
        inverse."""
        if noise.everyday not in self._precisions:
            whole = self.covariance + np.diag((noise.everyday * self.everyday) ** 2 + NONE)
            self._precisions[noise.everyday] = np.asarray(np.linalg.inv(whole)), float(np.linalg.slogdet(whole)[1])
        return self._precisions[noise.everyday]

    @cached_property
    def _states(self) -> dict[tuple[bytes, bytes, float], Marginal]:
        return {}

    def state(self, noise: Scatter) -> Marginal:
        """Everything that follows from a noise. Its levels and scales are of a grid, so that many hypotheses have the
        same; the last ones are kept."""
        key = noise.rho.tobytes(), noise.v.tobytes(), noise.everyday
        found = self._states.pop(key, None) or self._state(noise)
        self._states[key] = found
        if len(self._states) > REMEMBERED:
            del self._states[next(iter(self._states))]
        return found

    def _state(self, noise: Scatter) -> Marginal:
        told, cost = self.sums.information(noise), 0.0
        rounding = np.diag(ROUNDING * np.diag(told)[:-1])
        if self.moments:
            lost, cost = self.moments.told(noise)
            told = told - lost
        known, inside = told[:-1, :-1], self.mean
        common, vague = self.sums.common(noise)
        score = told[:-1, -1] - common - known @ inside
        energy = told[-1, -1] - 2.0 * inside @ told[:-1, -1] + inside @ known @ inside
        precision, spread = self.precision(noise)
        known = (known + known.T) / 2.0
        root = np.linalg.cholesky(known + precision + rounding)
        lower = np.tril(dpotri(root, lower=True)[0])
        covariance = lower + np.tril(lower, -1).T
        fitted = covariance @ score
        log = -0.5 * (energy - score @ fitted) - 0.5 * spread - float(np.sum(np.log(np.diag(root))))
        vague = vague - (vague @ covariance) @ known
        return Marginal(known, covariance, fitted, score - known @ fitted, vague, log - cost + self.sums.norm(noise))

    def own(self, which: tuple[int, ...]) -> list[int]:
        """The columns of some forms."""
        return [c for p in which for c in self.scene.forms[p].columns]

    def _sizes(self, which: tuple[int, ...], state: Marginal) -> tuple[list[int], Fitted]:
        """Columns and sizes of some forms."""
        own, taken = self.own(which), self.already(which)
        certain = np.concatenate([np.zeros(0), *(beside(self.scene.forms[p]) for p in which)])
        precision = np.where(certain > 0.0, certain, WIDE)
        information = positive(state.information(own)) + np.diag(precision)
        vague = state.vague[:, own].T @ state.vague[:, own]
        alone = positive(np.linalg.inv(information)) if own else np.zeros((0, 0))
        covariance = alone + alone @ vague @ alone
        score = state.score[own] - precision * taken
        more = alone @ score
        known, told = (float(np.linalg.slogdet(each)[1]) for each in (information, information + vague))
        gain = 0.5 * float(score @ more - certain @ taken**2 + len(own) * np.log(2.0 * np.pi) - known)
        doubt = 0.5 * float(score @ (more - np.linalg.solve(information + vague, score)) + known - told)
        return own, Fitted(more, taken + more, covariance, gain, doubt)

    def already(self, which: tuple[int, ...]) -> Array:
        """What is taken out of the recording already (M,)."""
        zero = (np.zeros(len(self.scene.forms[p].columns)) for p in which)
        return np.concatenate([np.zeros(0), *(self.taken.get(p, z) for p, z in zip(which, zero, strict=True))])

    def _left(self, own: list[int], sizes: Array, state: Marginal) -> Array:
        left = np.append(-self.mean - state.fitted + state.gain(own) @ sizes, 1.0)
        left[own] -= sizes
        return left

    def under(self, which: tuple[int, ...], state: Marginal) -> tuple[float, Fitted, Array]:
        """Log of the marginal likelihood with sizes of some forms, but for the prior of the noise; those sizes; the
        coefficients (K+1,) of what it leaves."""
        own, fitted = self._sizes(which, state)
        log, k = state.log + fitted.gain, 0
        for p in which:
            column = self.scene.forms[p]
            m, axes = len(column.columns), column.measured
            unit = self.scene.spread[list(column.columns)]
            error = fitted.covariance[k : k + m, k : k + m] * np.outer(unit, unit)
            sizes = fitted.sizes[k : k + m] * unit
            log += log_size(column, sizes, error) + float(np.sum(np.log(unit[:axes]))) + self.told(p, sizes)
            log -= 0.5 * float(np.log(2.0 * np.pi)) * (m - axes)
            k += m
        return log, fitted, self._left(own, fitted.more, state)

    @cached_property
    def _none(self) -> Hypothesis:
        """No effect, and the noise that it needs."""
        return self.hypothesis((), self.usual)

    def doubted(self, which: tuple[int, ...], base: Hypothesis) -> float:
        """By how much the forms that `base` lacks are less probable [nats] because noise in column and residual is not
        told exactly: under the noise that a recording without them has. Under the noise of the effect, which is less,
        that would outweigh any evidence. One more form gives nothing back of what the others are doubted."""
        state = self.state(base.noise)
        whole, before = (self._sizes(each, state)[1].doubt for each in (which, base.which))
        return base.doubt + max(whole - before, 0.0)

    def _settled(self, which: tuple[int, ...], noise: Scatter) -> tuple[Scatter, Marginal]:
        """The noise of a hypothesis, maximised in turns with what it leaves (expectation maximisation)."""
        state = self.state(noise)
        for _ in range(ROUNDS):
            left, before = self.under(which, state)[2], noise
            energies = self._energies(left, state.covariance, noise)
            noise = settled_noise(self.sums, energies, self.usual)._replace(everyday=before.everyday)
            if np.array_equal(noise.rho, before.rho) and np.array_equal(noise.v, before.v):
                break
            state = self.state(noise)
        return noise, state

    def hypothesis(self, which: tuple[int, ...], noise: Scatter, doubt: float | None = None) -> Hypothesis:
        """A hypothesis with its own noise; `doubt` [nats], by default that of all its sizes beside none."""
        if doubt is None:
            doubt = self.doubted(which, self._none) if which else 0.0
        noise, state = self._settled(which, noise)
        log, fitted, left = self.under(which, state)
        prior = sum(float(log_prior(noise.rho[r], noise.v[r], self.usual, r)) for r in range(len(noise.rho)))
        errors, log = np.sqrt(np.diag(fitted.covariance)), log - doubt + prior + self.apart
        return Hypothesis(which, log, noise, fitted.sizes, errors, self.rest(left, noise), doubt)

    def with_more(self, base: Hypothesis, form: int) -> Hypothesis:
        """A hypothesis with one form more."""
        which = tuple(sorted((*base.which, form)))
        return self.hypothesis(which, base.noise, self.doubted(which, base))

    def likeliest(self, which: tuple[int, ...], noise: Scatter, doubt: float | None = None) -> Hypothesis:
        """A hypothesis with the everyday differences under which it is the most probable."""
        each = [self.hypothesis(which, noise._replace(everyday=share), doubt) for share in STEADY]
        return max(each, key=lambda h: h.log)

    def _energies(self, left: Array, covariance: Array, noise: Scatter) -> tuple[Array, Array]:
        found = self.sums.energies(left, covariance)
        if not self.moments:
            return found
        more = self.moments.energies(left, noise)
        white, smooth = (np.maximum(a + b, SINGLE * a) for a, b in zip(found, more, strict=True))
        return white, smooth

    def rest(self, left: Array, noise: Scatter | None = None) -> float:
        """What is left at the worst joint, of the floor (rms); with `noise` beside what happens at moments."""
        return float(np.max(self.rests(left, noise)))

    def rests(self, left: Array, noise: Scatter | None = None) -> Array:
        """Return the same figure for every joint (R,)."""
        energy = np.einsum("i,rij,j->r", left, self.sums.whole, left)
        if self.moments and noise is not None:
            white, smooth = self.moments.energies(left, noise)
            energy = np.maximum(energy + white + np.sum(smooth, axis=1), 0.0)
        return np.asarray(np.sqrt(energy / np.maximum(self.sums.rows, 1.0)))

    def detectable(self, noise: Scatter) -> dict[tuple[str, str], float]:
        """Return the smallest detectable size of every effect at every place, of its most telling form."""
        state, found = self.state(noise), dict[tuple[str, str], float]()
        for form in self.scene.forms:
            k = form.columns[0]
            told = float(state.information([k])[0, 0])
            error = float(self.scene.spread[k]) * told**-0.5 if told > 0.0 else np.inf
            key = (form.name, form.at)
            found[key] = min(SIGMAS * error, found.get(key, np.inf))
        return found

    def shows_at(self, form: int) -> set[int]:
        """Return the joints (from 0) at which the columns of a form are largest against the floor, one of each."""
        own = list(self.scene.forms[form].columns)
        energy = self.sums.whole[:, own, own] / np.maximum(self.sums.rows, 1.0)[:, None]
        return set(np.argmax(energy, axis=0).tolist())
