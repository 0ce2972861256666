"""Slow adaptation in service: friction and pressure zeros follow temperature and wear, while the bucket returns empty.

The parameters identified at commissioning remain the reference; only their drift is estimated. The carry-back is
unknown: a usual amount, which is the same in all returns, and a deviation of its own in every return. Both are
estimated beside the drift, so that a residual that a load explains does not become drift. The prior of the usual amount
counts once, however many returns there are.

All cylinders have the same oil. A changed friction of one cylinder is therefore evidence for the others, which a return
may hardly excite. The recursive least squares fade old information only in the directions that the present motion
measures, so that nothing changes while the machine is parked. The drift is limited to its physical range, and is also
computed in kilograms."""

from dataclasses import dataclass
from functools import cache
from typing import Protocol, Self

import numpy as np

from cylforce.estimation.drift import daily_correlation, daily_spread, drift_spread, kinds
from cylforce.estimation.kernel import choice
from cylforce.estimation.kernel.drifting import KernelDrift
from cylforce.estimation.kernel.functions import Kernel
from cylforce.estimation.kernel.layout import DriftLayout, part
from cylforce.estimation.kernel.making import counts, numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.solving import ZERO
from cylforce.estimation.model import CERTAIN_SHARE, BetweenStrokes, Model, Tares
from cylforce.estimation.recursive import Root
from cylforce.service.residual import InstantResidual
from cylforce.service.snapshot import Constants, Estimator
from cylforce.signals.estimate import Array

MEMORY_SECONDS = 30.0  # s of empty motion after which old information has faded to 1/e; chosen
STROKE_SECONDS = 3.0  # s, duration of a typical stroke, over which model errors keep their sign; chosen
EVERY = 5  # steps between updates, because neighbouring samples contain the same information; chosen
ZERO_LIMIT = 6e5  # Pa, limit of a pressure's zero drift; chosen
FRICTION_RANGE = (0.1, 10.0)  # times the identified friction: limits of the adapted friction, of oil from 0 to 100 degC
PRIOR_COUNT = 1.0  # number of measurements that count as much as the prior spread of the drift; chosen: one
# times the rated payload: prior mean and standard error of the usual carry-back; standard deviation of a return from
# it. On machines of either simulator the carry-back is 0.7 %, with 0.5 % from return to return. The prior mean is
# lower, because a clean bucket must not read a kilogram less. Both errors together, of the first return, are 0.8 %.
USUAL, UNUSUAL = (0.003, 0.006), 0.005
LOAD = 4  # parameters of a load: m, m x, m z, J
OWN = LOAD + 1  # unknowns before the drift: deviation of the load from the usual one (4), the usual amount (1)
SHOWN = 0.02  # share of the difference by which each update changes the drift in kilograms; chosen: smooths it


class DriftKnowledge(Protocol):
    """Interface of an estimated drift: values (D,) and covariance (D, D)."""

    @property
    def values(self) -> Array:
        """Drift (D,) of friction [N, N s/m] and zeros [N]."""

    @property
    def covariance(self) -> Array:
        """Covariance (D, D) of the drift."""


@dataclass(frozen=True, slots=True)
class KnownDrift:
    """Drift that does not change.

    values:     (D,) friction [N, N s/m], zeros [N]
    covariance: (D, D) of the values
    """

    values: Array
    covariance: Array


@cache
def no_drift(size: int) -> KnownDrift:
    """Return a drift of `size` parameters that is zero without error."""
    return KnownDrift(np.zeros(size), np.zeros((size, size)))


class DriftConstants(Constants):
    """Constants of the adaptation of one machine.

    model:       of the machine
    tares:       of the machine
    strokes:     spread of friction and zeros between strokes, if they may have drifted by that only; None: they may
                 have drifted as from day to day
    spread:      (D,) prior standard errors of the drift
    correlation: (D, D) prior correlation of the drift
    deviation:   (4,) standard errors of a return's load less the usual one [kg, kg m, kg m, kg m^2]
    usual:       (4,) load (m, m x, m z, J) of one kilogram of the usual amount [kg, kg m, kg m, kg m^2]
    layout:      names of the places in the kernel's results
    memory:      number of updates that count as one independent measurement
    plan:        all these constants, as the kernel takes them
    """

    def __init__(
        self, model: Model, tares: Tares, strokes: BetweenStrokes | None = None, kernel: Kernel | None = None
    ) -> None:
        """Compute the prior spreads of the drift and of the carry-back (material that stays in the returning bucket).

        The drift is the change of friction [N, N s/m] and pressure zeros [N] since the identification.

        model:   of the machine
        tares:   identified parameters of the empty machine
        strokes: spread of friction and zeros between strokes, if they may have drifted by that only; None: they may
                 have drifted as from day to day
        kernel:  form of the kernel; None: the compiled one if there is one
        """
        self.model, self.tares, self.strokes, self.kernel = model, tares, strokes, kernel or choice.chosen()
        if strokes is None:
            self.spread, self.correlation = daily_spread(model, tares.values), daily_correlation(model)
        else:
            self.spread = drift_spread(model, tares.values, strokes)
            self.correlation = np.eye(len(self.spread))
        machine, reach = model.machine, model.machine.payload_reach
        # standard errors (4,) of the carry-back of one return less the usual load, anywhere in the bucket
        self.deviation = UNUSUAL * machine.rated_payload * np.array([1.0, reach, reach, reach**2], dtype=np.float64)
        # load (4,) of one kilogram of the usual amount: in the middle of the bucket
        self.usual = np.array([1.0, 0.5 * reach, 0.0, 0.25 * reach**2], dtype=np.float64)
        # model errors keep their sign for about one stroke
        self.memory = STROKE_SECONDS * model.filters.rate_hz / EVERY
        self.layout = DriftLayout(len(self.spread))
        self.plan = self._plan()

    def limits(self) -> tuple[Array, Array]:
        """Return the smallest and the largest possible drift (D,), friction first [N, N s/m], then zeros [N].

        Friction with its drift stays between FRICTION_RANGE times the identified one. A zero drifts by at most
        ZERO_LIMIT [Pa] on the head side of its cylinder, either way."""
        friction = np.abs(self.tares.values[self.model.changing_friction])
        zero = np.array([ZERO_LIMIT * c.area_head for c in self.model.machine.cylinders])
        low = np.concatenate([(FRICTION_RANGE[0] - 1.0) * friction, -zero])
        return low, np.concatenate([(FRICTION_RANGE[1] - 1.0) * friction, zero])

    def _plan(self) -> KernelDrift:
        """Return all constants of the adaptation in the form that the kernel takes.

        They are: which columns the unknowns have (load, friction, zeros), their prior spreads, their limits, the errors
        of the rows, and how fast old information fades. The kernel also fits the spread of the drift to this machine:
        k^2 (2,) of friction and of zeros, with one step of expectation maximisation per update. A drift that was not
        excited does not change k. The priors of drift and usual amount are no part of the recursive information, so
        that they neither fade nor grow where nothing is excited."""
        model, r = self.model, len(self.model.machine.rows)
        k, n, places = len(model.filtered.regressor.names), OWN + len(self.spread), np.argwhere(model.load)
        keep = 1.0 - EVERY / (MEMORY_SECONDS * model.filters.rate_hz)
        whole = [model.changing.tolist(), kinds(model).tolist(), places.ravel().tolist(), [0] * r]
        whole += [np.arange(k)[columns].tolist() for columns in (model.at_rest, model.coulomb)]
        usual = [USUAL[1] * model.machine.rated_payload]
        unit = np.concatenate([self.deviation, usual, self.spread])
        errors = np.broadcast_to(self.tares.row_error, (r,))
        parts = [model.load[tuple(places.T)], unit, *self.limits(), errors]
        room = [np.zeros(size) for size in (max(r, 1) * n, max(r, 1) * n, n, n * n, n * n)]
        limits = [CERTAIN_SHARE, keep, self.memory, PRIOR_COUNT, SHOWN, USUAL[0] / USUAL[1]]
        arrays = [numbers(each) for each in (*parts, np.linalg.inv(self.correlation).ravel(), self.usual, *room)]
        return self.kernel.KernelDrift(counts([r, k, n]), numbers(limits), [counts(x) for x in whole], arrays)


@dataclass(slots=True)
class DriftFilter(Estimator):
    """Recursive least squares of the drift of friction and pressure zeros.

    constants:  of the machine
    root:       information about carry-back and drift (5 + D): deviation from the usual load (4), including its prior;
                usual amount [kg] and drift (D), without their priors
    values:     (D,) drift, added to the tares: Coulomb and viscous friction [N, N s/m], then pressure zeros [N]
    covariance: (D, D) of the drift
    scale:      (2,) this machine's variance of friction and of zeros, over the variance of the prior
    waited:     number of usable instants since the last update
    mass:       weight that the empty bucket would show without the adaptation, smoothed over the updates [kg]
    following:  whether the last instant was usable; else nothing changes
    informed:   whether the root contains information about the present carry-back
    updates:    number of updates of all returns so far
    returned:   whether there were as many updates as count as one independent measurement (`DriftConstants.memory`);
                from the start True if only a drift between strokes is expected
    """

    constants: DriftConstants
    root: Root
    values: Array
    covariance: Array
    scale: Array
    waited: int
    mass: float
    following: bool
    informed: bool
    updates: int
    returned: bool

    @classmethod
    def start(cls, constants: DriftConstants) -> Self:
        """Return the state before any return: no drift of friction and zeros, with its prior standard errors.

        The information on the 5 + D unknowns begins with the prior of the carry-back's deviation from the usual one, as
        a load (4). The priors of the usual carry-back (1) and of the drift (D) are added by the kernel at each update,
        so that they do not fade."""
        drift = np.zeros_like(constants.spread)
        information = np.diag(np.concatenate([1.0 / constants.deviation, [0.0], drift]))
        return cls(
            constants,
            root=Root(information, np.zeros(OWN + len(drift))),
            values=drift,
            covariance=constants.correlation * np.outer(constants.spread, constants.spread),
            scale=np.ones(2),
            waited=0,
            mass=0.0,
            following=False,
            informed=False,
            updates=0,
            returned=bool(constants.strokes),
        )

    def pause(self) -> None:
        """Begin another return of the empty bucket, because the bucket was loaded: the carry-back may be another one.

        What is known about the carry-back's deviation from its usual amount is discarded, what is known about the usual
        amount and the drift is kept. The triangle of the information (`root`) lists the deviation first, so that its
        lower part is the information on the others when the deviation is unknown."""
        self.following = False
        if not self.informed:
            return
        factor, right = np.zeros_like(self.root.factor), np.zeros_like(self.root.right)
        factor[LOAD:, LOAD:], right[LOAD:] = self.root.factor[LOAD:, LOAD:], self.root.right[LOAD:]
        factor[:LOAD, :LOAD] = np.diag(1.0 / self.constants.deviation)
        self.root, self.informed = Root(factor, right), False

    def update(self, residual: InstantResidual, usable: Numbers) -> None:
        """Update the drift of friction and pressure zeros with one instant with an empty bucket in the air.

        Only every EVERY-th instant with a row that can be used changes the drift.

        Rows at very low speed are not used: break-away friction would appear there as a pressure zero and, with the
        opposite sign, as Coulomb friction. A boom that always moves down while the bucket is empty determines only the
        sum of both, so that such an error would remain.

        residual: measured joint torques less those of the empty machine (tares) and of the present drift [N m]
        usable:   (R,) 1 where the row of a measured joint torque can be used, else 0
        """
        c = self.constants
        number = c.kernel.rows_for_drift(c.plan, residual.rows, usable)
        self.following = number > 0
        if not number:
            return
        self.waited += 1
        if self.waited < EVERY:
            return
        self.waited = 0
        place, d, n = c.layout, self.values.size, self.root.right.size
        after = ZERO * place.size
        instant = (residual.rows, residual.numbers, residual.wider)
        root = self.root
        c.kernel.update_drift(
            c.plan, number, *instant, root.factor, root.right, self.values, self.scale, self.mass, after
        )
        self.root = Root(part(after, place.factor).reshape(n, n), part(after, place.right))
        self.values = part(after, place.values)
        self.covariance = part(after, place.covariance).reshape(d, d)
        self.scale, self.mass = part(after, place.scale), after[place.mass]
        self.informed = True
        self.updates += 1
        self.returned = self.returned or self.updates >= c.memory
