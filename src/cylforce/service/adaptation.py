"""Slow adaptation in service: friction and pressure zeros follow temperature and wear, while the bucket returns empty.

The parameters identified at commissioning remain the reference; only their drift is estimated. What sticks in the
bucket is unknown: a usual amount, which is the same in all returns, and a deviation from it, another one in every
return. Both are estimated beside the drift, so that only what no load explains is taken for a drift. The prior of the
usual amount counts once, however many returns there are.

All cylinders have the same oil: what is seen of one friction is expected of the others, too, which a return may hardly
show. The recursive least squares forget only what the present motion measures, so that nothing changes while the
machine is parked. The drift is limited to what is physically possible, and is also given in kilograms."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.drift import daily_correlation, daily_spread, drift_spread, kinds
from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.model import CERTAIN_SHARE, BetweenStrokes, Model, Tares
from cylforce.estimation.recursive import Root
from cylforce.estimation.regressor import Rows
from cylforce.service.pipeline import Unexplained
from cylforce.signals.estimate import Array
from cylforce.signals.quick import once

MEMORY_SECONDS = 30.0  # s of empty motion after which old information has faded to 1/e; chosen
STROKE_SECONDS = 3.0  # s, duration of a typical stroke, over which model errors keep their sign; chosen
EVERY = 5  # steps between updates, because neighbouring samples contain the same information; chosen
ZERO_LIMIT = 6e5  # Pa, limit of a pressure's zero drift; chosen
FRICTION_RANGE = (0.1, 10.0)  # times the identified friction: limits of the adapted friction, of oil from 0 to 100 degC
PRIOR_COUNT = 1.0  # measurements that the prior spread of the drift is worth; chosen: one
# times the rated payload: what usually sticks in a bucket before anything is seen of it, mean and standard error; by
# how much a return deviates from that. On machines of either simulator 0.7 +- 0.5 % sticks, the error from return to
# return. The mean is lower: a clean bucket must not cost a kilogram. Both errors together are 0.8 %, of the first one.
USUAL, UNUSUAL = (0.003, 0.006), 0.005
LOAD = 4  # parameters of a load: m, m x, m z, J
OWN = LOAD + 1  # unknowns before the drift: by how much a load deviates from the usual one, the usual amount
SHOWN = 0.02  # share of the difference by which each update changes the drift in kilograms; chosen: smooths it


class Drift(NamedTuple):
    """State of the adaptation.

    root:       information about the load that remains in the bucket and the drift (5 + D): deviation from the usual
                load (4), with its prior; usual amount [kg] and drift (D), without
    values:     (D,) drift, added to the tares: Coulomb and viscous friction, then pressure zeros
    covariance: (D, D) of the drift
    scale:      (2,) variance of friction and of zeros in units of the prior's
    waited:     steps since the last update
    mass:       what the empty bucket would show without the adaptation [kg]
    following:  whether this instant was usable, else nothing changes
    seen:       whether the information is in part about what remains in the bucket now
    told:       updates so far
    returned:   whether they are one measurement or more, or a drift was not expected
    """

    root: Root
    values: Array
    covariance: Array
    scale: Array
    waited: int
    mass: float
    following: bool
    seen: bool
    told: int = 0
    returned: bool = False


@dataclass(frozen=True)
class Adapter:
    """The adaptation of one machine; `strokes`: how friction and zeros differ between strokes, if that is all by which
    they may have drifted; None: they are those of another day."""

    model: Model
    tares: Tares
    strokes: BetweenStrokes | None = None
    kernel: Any = field(default_factory=lambda: choice.chosen())  # noqa: PLW0108 - asked when it is made

    @once
    def _limits(self) -> tuple[Array, Array]:
        friction = np.abs(self.tares.values[self.model.changing_friction])
        zero = np.array([ZERO_LIMIT * c.area_head for c in self.model.machine.cylinders])
        low = np.concatenate([(FRICTION_RANGE[0] - 1.0) * friction, -zero])
        return low, np.concatenate([(FRICTION_RANGE[1] - 1.0) * friction, zero])

    @property
    def _memory(self) -> float:
        """Updates that count as one independent measurement: model errors keep their sign for about one stroke."""
        return STROKE_SECONDS * self.model.filters.rate_hz / EVERY

    @once
    def _spread(self) -> Array:
        """Prior standard errors (D,) of the drift."""
        if self.strokes is None:
            return daily_spread(self.model, self.tares.values)
        return drift_spread(self.model, self.tares.values, self.strokes)

    @once
    def _alike(self) -> Array:
        """Its correlation (D, D)."""
        return np.eye(len(self._spread)) if self.strokes else daily_correlation(self.model)

    def begin(self) -> Drift:
        """The state without drift, with the prior standard errors above."""
        drift = np.zeros_like(self._spread)
        root = Root(np.diag(np.concatenate([1.0 / self._deviation, [0.0], drift])), np.zeros(OWN + len(drift)))
        covariance = self._alike * np.outer(self._spread, self._spread)
        return Drift(
            root, drift, covariance, np.ones(2), 0, 0.0, following=False, seen=False, returned=bool(self.strokes)
        )

    @once
    def _deviation(self) -> Array:
        """Standard errors (4,) of what remains in one return less the usual load: anywhere in the bucket."""
        machine = self.model.machine
        reach = machine.payload_reach
        return UNUSUAL * machine.rated_payload * np.array([1.0, reach, reach, reach**2], dtype=np.float64)

    @once
    def _usual(self) -> Array:
        """Load (4,) of one kilogram of the usual amount: in the middle of the bucket."""
        reach = self.model.machine.payload_reach
        return np.array([1.0, 0.5 * reach, 0.0, 0.25 * reach**2], dtype=np.float64)

    def loaded(self, drift: Drift) -> Drift:
        """The state after the bucket was not empty: by how much the next return deviates from the usual is unknown.

        The triangle of the root lists the deviation first, so that its lower part is the information about the usual
        amount and the drift when the deviation is unknown."""
        if not drift.seen:
            return drift._replace(following=False) if drift.following else drift
        factor, right = np.zeros_like(drift.root.factor), np.zeros_like(drift.root.right)
        factor[LOAD:, LOAD:], right[LOAD:] = drift.root.factor[LOAD:, LOAD:], drift.root.right[LOAD:]
        factor[:LOAD, :LOAD] = np.diag(1.0 / self._deviation)
        return drift._replace(root=Root(factor, right), following=False, seen=False)

    def columns(self, rows: Rows) -> Array:
        """Columns (R, D) of the adapted parameters."""
        return np.asarray(rows.columns[..., self.model.changing])

    def step(self, drift: Drift, left: Unexplained, usable: Numbers) -> Drift:
        """The drift after one instant with an empty bucket in the air: what the drift so far has `left`, and which rows
        (R,) are `usable`.

        Rows at very low speed are not used: break-away friction would appear there as a pressure zero and, with the
        opposite sign, as Coulomb friction. A boom that always moves down while the bucket is empty shows only the sum
        of both, so that such an error would remain."""
        number = self.kernel.certain(self._plan, left.rows, usable)
        if not number:
            return drift._replace(following=False)
        if drift.waited + 1 < EVERY:
            return drift._replace(waited=drift.waited + 1, following=True)
        d, n = drift.values.size, drift.root.right.size
        new = ZERO * (n * n + n + d + d * d + 3)
        begun = (drift.root.factor, drift.root.right, drift.values, drift.scale, drift.mass)
        self.kernel.follow(self._plan, number, *left, *begun, new)
        whole, end = np.frombuffer(new), n * n + n
        root = Root(whole[: n * n].reshape(n, n), whole[n * n : end])
        covariance = whole[end + d : -3].reshape(d, d)
        told, returned = drift.told + 1, drift.returned or drift.told + 1 >= self._memory
        found = Drift(root, whole[end : end + d], covariance, whole[-3:-1], 0, new[-1], following=True, seen=True)
        return found._replace(told=told, returned=returned)

    @once
    def _plan(self) -> Any:  # noqa: ANN401 - the compiled or the interpreted class
        """The kernel's form of the adaptation. The spread of the drift is that of this machine: k^2 (2,) of friction
        and of zeros, one step of expectation maximisation an update, as between strokes (`commissioning.zeros`). A
        drift that was not seen leaves k as it is. The priors of drift and usual amount are no part of the root: they
        are not forgotten, nor do they grow where nothing is seen."""
        model, r = self.model, len(self.model.machine.rows)
        k, n, places = len(model.filtered.regressor.names), OWN + len(self._spread), np.argwhere(model.load)
        keep = 1.0 - EVERY / (MEMORY_SECONDS * model.filters.rate_hz)
        whole = [model.changing.tolist(), self._kinds.tolist(), places.ravel().tolist(), [0] * r]
        whole += [np.arange(k)[part].tolist() for part in (model.at_rest, model.coulomb)]
        usual = [USUAL[1] * model.machine.rated_payload]
        unit = np.concatenate([self._deviation, usual, self._spread])
        errors = np.broadcast_to(self.tares.row_error, (r,))
        parts = [model.load[tuple(places.T)], unit, *self._limits, errors]
        room = [np.zeros(size) for size in (max(r, 1) * n, max(r, 1) * n, n, n * n, n * n)]
        limits = [CERTAIN_SHARE, keep, self._memory, PRIOR_COUNT, SHOWN, USUAL[0] / USUAL[1]]
        arrays = [numbers(part) for part in (*parts, np.linalg.inv(self._alike).ravel(), self._usual, *room)]
        return self.kernel.KernelDrift(counts([r, k, n]), numbers(limits), [counts(x) for x in whole], arrays)

    @once
    def _kinds(self) -> NDArray[np.int_]:
        return kinds(self.model)
