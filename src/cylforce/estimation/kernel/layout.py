"""Names for the places in the kernel's flat arrays, for the code around the kernel.

R rows (measured torques), K columns, D channels, C cylinders, P parameters of the empty machine, S signals."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cylforce.estimation.kernel.drifting import DRIFT
from cylforce.estimation.kernel.inputs import ACCEPTED_US, DOUBLED_US, SENDER, SIGNAL
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.estimation.kernel.weighed import (
    CENTRE,
    CENTRE_ERROR,
    COVARIANCE,
    DRIFT_MOMENT,
    GRAM,
    MASS,
    MASS_ERROR,
    RIGHT,
    SENSITIVITY,
    VALUES,
)
from cylforce.signals.estimate import Array


@dataclass(frozen=True)
class Sizes:
    """Numbers of a machine's parts.

    channels:  D, number of channels: joint angles, cylinder forces, motion of the base
    rows:      R, number of measured torques
    columns:   K, number of columns of the model (`Model.filtered`): parameters of the empty machine, force and moment
               at the tool, friction at rest, pressure zeros
    cylinders: C, number of cylinders
    """

    channels: int
    rows: int
    columns: int
    cylinders: int


def part(numbers: Numbers, place: slice) -> Array:
    """Return a NumPy view of the part `place` of a flat array of the kernel; the numbers are not copied."""
    return np.frombuffer(numbers)[place]


class FilterLayout:
    """Places in the state of the filters (`rows.state_size`), for D channels, R rows and K columns.

    raw:     (D,) last channels
    smooth:  (3, D) the last three outputs of their low-pass, oldest first
    waiting: (R,) steps for which a row is not used, because its filters still contain an unusable lever
    begin:   the numbers that are set before the first step: last channels, state of their low-pass and its outputs
    """

    def __init__(self, sizes: Sizes) -> None:
        """Compute the places for a machine of these sizes.

        The state begins with the last channels (D,), the state of their low-pass (2, D) and its last outputs (3, D).
        Then come the states of the filters of columns (3, R K) and torques (3, R), and the waiting steps (R,)."""
        d, r, k = sizes.channels, sizes.rows, sizes.columns
        self.raw = slice(0, d)
        self.smooth = slice(3 * d, 6 * d)
        self.begin = slice(0, 6 * d)
        waiting = 6 * d + 3 * r * (k + 1)
        self.waiting = slice(waiting, waiting + r)


class RowLayout:
    """Places in the rows of a step (`rows.rows_size`), one flat array in which these parts follow one another.

    A machine has R rows (measured torques), K columns and C cylinders (`Sizes`). A column is the torque [N m] per unit
    of its parameter, so that torque = columns @ parameters.

    shape:        (R, K) of each of the three parts that hold columns
    slow_columns: (R, K) columns with the filters of the weighing
    slow_torque:  (R,) torques with the filters of the weighing [N m]
    columns:      (R, K) columns of the instant, for the force
    torque:       (R,) torques of the instant [N m]
    change:       (R, K) time derivative of the columns of inertia, of the instant [1/s]
    reversing:    (C,) 1 where a cylinder is about to reverse, else 0
    levers:       (C, R) lever of each cylinder about the joint of each row [m/rad]
    place:        (2,) place x, z of the tool from the first pin [m]
    velocity:     (2,) velocity x, z of the tool [m/s]
    usable:       (R,) 1 where a row can be used, else 0
    speed:        (C,) speed of each cylinder [m/s], extending positive
    """

    def __init__(self, sizes: Sizes) -> None:
        """Compute the places, as slices of the flat array, for a machine of these sizes."""
        r, k, c = sizes.rows, sizes.columns, sizes.cylinders
        self.shape = (r, k)
        ends = np.cumsum([0, r * k, r, r * k, r, r * k, c, c * r, 2, 2, r, c]).tolist()
        places = [slice(begin, end) for begin, end in pairwise(ends)]
        self.slow_columns, self.slow_torque, self.columns, self.torque, self.change = places[:5]
        self.reversing, self.levers, self.place, self.velocity, self.usable, self.speed = places[5:]


class LiftLayout:
    """Places in the state of a lift (`weighed.take`): recursive least squares of its load (m, m x, m z, J).

    factor:     (4, 4) upper triangle U of the information U'U on the load
    right:      (4,) right-hand side z: U load = z
    values:     (4,) estimate for zero drift [kg, kg m, kg m, kg m^2]
    covariance: (4, 4) of the estimate
    gram:       (4, P + D) sum over the rows of load columns times tare and drift columns, over the row's variance: the
                estimate changes by -covariance @ gram per unit of tares and drift
    """

    factor = slice(0, RIGHT)
    right = slice(RIGHT, VALUES)
    values = slice(VALUES, COVARIANCE)
    covariance = slice(COVARIANCE, GRAM)
    gram = slice(GRAM, None)


LIFT = LiftLayout()


class GateLayout:
    """Places in the intermediate results of R rows of an instant (`weighed.gate`).

    columns:  (R, 4) of the load
    torque:   (R,) residual torque before the drift is subtracted [N m]
    variance: (R,) of the error of this torque, with which the row is weighted [N^2 m^2]
    taken:    (R,) 1 where the row is used for the load of the lift
    rested:   (R,) number of samples for which each row has been at rest, less those in motion since
    size:     of all numbers
    """

    def __init__(self, rows: int) -> None:
        """Compute the places of the parts in the test of an instant, for R `rows` (measured torques).

        The parts follow one another: columns (R, 4) of the load; residual torque, variance, whether the row is taken,
        and samples at rest, (R,) each."""
        self.columns = slice(0, 4 * rows)
        self.torque, self.variance, self.taken, self.rested = (slice(k * rows, (k + 1) * rows) for k in range(4, 8))
        self.size = 8 * rows


class ConclusionLayout:
    """Places in the result of a lift (`weighed.conclude`), with P tares and D drifts.

    mass:             [kg]
    error:            its standard error [kg]
    x, z:             centre of the load [m]
    x_error, z_error: standard errors of the centre [m]
    drifted:          standard error of the load's first moment by that of the drift [kg m]
    size:             of all numbers; the last ones are (P + D,) change of the mass [kg] per unit of each tare and
                      drift, sign reversed
    """

    def __init__(self, parameters: int, drifts: int) -> None:
        """Set the places of the numbers in the result of a lift: mass, centre, their errors, and sensitivities.

        The sensitivities (P + D,) of the mass to P `parameters` and D `drifts` come last."""
        self.mass, self.error = MASS, MASS_ERROR
        self.x, self.z = CENTRE, CENTRE + 1
        self.x_error, self.z_error = CENTRE_ERROR, CENTRE_ERROR + 1
        self.drifted = DRIFT_MOMENT
        self.size = SENSITIVITY + parameters + drifts


class DriftLayout:
    """Places in the result of an update of D drifts (`drifting.update_drift`), of which the information has N unknowns.

    A drift is the change of a friction or a pressure zero since the identification. Carry-back is the material that
    stays in the emptied bucket; a return is the motion with it to the next dig.

    factor:     (N, N) upper triangle U of the information U'U
    right:      (N,) right-hand side z: U unknowns = z
    values:     (D,) drift of frictions [N, N s/m] and pressure zeros [N]
    covariance: (D, D) of the drift
    scale:      (2,) variance of this machine's frictions, and that of its zeros, in units of the prior variances
    mass:       that the empty bucket would show without the adaptation, as a mass at the last pin [kg]
    size:       of all numbers
    """

    def __init__(self, drifts: int) -> None:
        """Compute the places of the parts of the adaptation's result, for D `drifts` of friction and pressure zeros.

        The parts follow one another in one array: factor (N, N) and right-hand side (N,) of the information on N
        unknowns, drift (D,), its covariance (D, D), the scale (2,) of the priors, and the mass [kg]. The N = 5 + D
        unknowns are the deviation of this return's carry-back from the usual one, as a load m, m x, m z, J (4); the
        mass of the usual carry-back (1), whose first moments and inertia per kilogram are fixed; the drifts (D)."""
        n, d = DRIFT + drifts, drifts  # DRIFT: the five unknowns of the carry-back
        ends = np.cumsum([0, n * n, n, d, d * d, 2]).tolist()
        self.factor, self.right, self.values, self.covariance, self.scale = map(slice, ends[:-1], ends[1:])
        self.mass = ends[-1]
        self.size = self.mass + 1


class ResidualLayout:
    """Places in the residual of R rows (`weighed.residual_torque`).

    torque:   (R,) residual torque of tares and drift [N m]
    variance: (R,) without friction at rest [N^2 m^2]
    rest:     (R,) variance of friction at rest [N^2 m^2]
    """

    def __init__(self, rows: int) -> None:
        """Compute the places of the parts in a residual, for R `rows` (measured torques).

        The parts are the residual torque, its variance, and the variance of friction at rest, (R,) each; the columns
        (R, D) of the drift follow."""
        self.torque = slice(0, rows)
        self.variance = slice(rows, 2 * rows)
        self.rest = slice(2 * rows, 3 * rows)


class SampleLayout:
    """Places in the sample of S signals at a tick (`inputs.usable`).

    values:  (S,) values [SI]
    reasons: (S,) reason why each is not usable, as a number of `Reason`
    late:    reason why the last value of a signal was refused or is late, though an older one is still used; of the
             last such signal, as a number of `Reason`
    stepped: number of signals whose value jumped implausibly and stayed there
    size:    of all numbers
    """

    def __init__(self, signals: int) -> None:
        """Compute the places of the parts in the sample of a tick (an instant of the fixed step), for S `signals`.

        The parts follow one another: values (S,), reasons (S,) why each is not usable, reason `late`, number of signals
        whose value jumped implausibly and stayed there."""
        self.values, self.reasons = slice(0, signals), slice(signals, 2 * signals)
        self.late, self.stepped = 2 * signals, 2 * signals + 1
        self.size = 2 * signals + 2


class InputLayout:
    """Places in the state of the sensors' inputs (`inputs.receive`): S signals, P PDOs, M nodes, frame counters.

    arrivals:    time at which the frame of each signal's last accepted value was received [us]
    second_us:   time of the last sign of a second producer of each PDO [us]
    unknown:     number of frames with an unknown identifier
    short, long: numbers of frames shorter or longer than their mapping
    long_us:     time of the last frame that was too long [us]
    foreign_us:  time of the last frame of another node with one of our identifiers [us]
    size:        of all numbers
    """

    def __init__(self, signals: int, pdos: int, nodes: int) -> None:
        """Compute the places of the parts in the state of the sensors' inputs.

        The state lists S `signals` with SIGNAL numbers each, P `pdos` and M `nodes` with SENDER numbers each, then the
        frame counters: frames with an unknown identifier, too short, too long, and the times [us] of the last one that
        was too long and of the last one that another node sent with our identifiers."""
        self.signals, self.pdos, self.nodes = signals, pdos, nodes
        self._pdos = SIGNAL * signals
        self._nodes = self._pdos + SENDER * pdos
        counters = self._nodes + SENDER * nodes
        self.unknown, self.short, self.long, self.long_us, self.foreign_us = range(counters, counters + 5)
        self.size = counters + 5
        self.arrivals = slice(ACCEPTED_US, self._pdos, SIGNAL)
        self.second_us = slice(self._pdos + DOUBLED_US, self._nodes, SENDER)

    def signal(self, number: int) -> slice:
        """Return the place of a signal, in the order of `senders.channels.Channel`."""
        return slice(SIGNAL * number, SIGNAL * (number + 1))

    def pdo(self, number: int) -> slice:
        """Return the place of a PDO, in the order of `senders.channels.PdoRate`."""
        begin = self._pdos + SENDER * number
        return slice(begin, begin + SENDER)

    def node(self, number: int) -> slice:
        """Return the place of a node, in the order of `senders.channels.LastHeartbeat`."""
        begin = self._nodes + SENDER * number
        return slice(begin, begin + SENDER)


class ForceLayout:
    """Places in the force of R rows (`pushed.tool_force`).

    x, z:       force at the tool [N]
    xx, xz, zz: its covariance [N^2]
    weight:     of the mass in the bucket that explains most of the force [N]
    clearness:  f' C^-1 f of the force f without that weight
    wider_xx, wider_xz, wider_zz: covariance by errors of signals [N^2]
    size:       of all numbers
    """

    def __init__(self, rows: int) -> None:
        """Compute the places of the parts in the force of an instant, for R `rows` (measured torques).

        In front of the force are residual torque (R,) and variance of friction of unknown sign (R,). Behind its
        covariance (2, 2) are gain (2, R) and columns of the load (R, 4)."""
        force = 2 * rows  # after the residual torque (R,) and the variance of friction of unknown sign (R,)
        self.x, self.z, self.xx, self.xz, self.zz = force, force + 1, force + 2, force + 3, force + 5
        last = 8 * rows + 6  # after the gain (2, R) and the columns of the load (R, 4)
        self.weight, self.clearness, self.wider_xx, self.wider_xz, self.wider_zz = range(last, last + 5)
        self.size = last + 5
