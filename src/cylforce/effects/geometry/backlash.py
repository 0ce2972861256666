"""Play (backlash) in a joint."""

from dataclasses import dataclass

import numpy as np

from cylforce.effects.fault import About, Place, ShapeRange
from cylforce.mechanics.machine import Machine, base_parameters
from cylforce.mechanics.reading import angle_signal, followed, measured_torque, rigid_torque
from cylforce.signals.estimate import Array

SMOOTHING = 0.03  # s: noise of pressures does not throw a link to and fro; chosen, below the time of a fall


@dataclass(frozen=True, slots=True)
class Backlash:
    """Play in a joint, beyond the cylinder and its friction: the measured angle is wrong by half the play.

    The sign is the side to which weight and inertia of the outer links press. Where that torque changes its sign, the
    joint moves to the other side as fast as the torque accelerates the inertia, and stays (no rebound). Where it never
    does, play is an offset of the angle, and no effect of its own. With `pushed` the play is between the joint and its
    cylinder, whose friction lies on the far side. The angle then jumps where the torque of the measured forces changes
    its sign.
    """

    falling: float = 0.015  # rad, play from which the time of the fall is computed: it grows with the square root only
    pushed: bool = False  # whether the play is between the joint and its cylinder

    @property
    def about(self) -> About:
        """Description of the effect: name, unit, plausible range, location, regimes, confirming experiment."""
        return About(
            name="backlash",
            unit="rad",
            low=0.002,
            high=0.05,
            place=Place.LINK,
            shows="where the joint's torque changes its sign",
            confirm="push the link by hand, or with the tool on the ground, both ways",
            sign=1,
            form=0.2,  # chosen: it rebounds, and its load moves it differently
        )

    @property
    def shapes(self) -> tuple[ShapeRange, ...]:
        """Range of `falling`: about.low to about.high."""
        return (ShapeRange("falling", 0.002, 0.05, log=True),)

    def distorted(self, machine: Machine, values: Array, t: Array, where: int, size: float) -> Array:
        """Return the signals (T, S) with the joint's angle changed to a + size/2 s, s from -1 to 1 the position in the
        play.

        The same object without an angle sensor. No reading changes where the joint stays on one side throughout.

        values: (T, S) signals without the error [SI]
        t:      (T,) time, evenly spaced [s]
        where:  number of the joint
        size:   play [rad]
        """
        signal, found = angle_signal(machine, where), values.copy()
        if signal is None:
            return values
        inertia = float(np.sum(base_parameters(machine.links)[3 * where :: 3]))
        if len(t) > 1 and inertia > 0.0:
            pressed = np.nan_to_num(self._pressing(machine, values, t, where)) / inertia  # unknown: no change of side
            place = fallen(pressed, float(np.mean(np.diff(t))), self.falling)
            if np.any(place != place[0]):
                found[:, signal] += size / 2.0 * place
        return found

    def _pressing(self, machine: Machine, values: Array, t: Array, where: int) -> Array:
        """Return the torque (T,) [N m] that decides on which side of the play the joint lies.

        It is the torque that carries and moves the outer links, by the data sheet's masses; with `pushed` that of the
        measured cylinder forces, after a first-order lag of SMOOTHING [s].

        values: (T, S) of all signals [SI]
        t:      (T,) times, evenly spaced [s]
        where:  number of the joint
        """
        if self.pushed:
            return followed(np.nan_to_num(measured_torque(machine, values, where)), t, SMOOTHING)
        return rigid_torque(machine, values, t, where)


def fallen(pressed: Array, step: float, play: float) -> Array:
    """Return the position (T,) in a play: 1 on the side to which a positive acceleration presses, -1 on the other.

    On the way from side to side it is between these. It begins on the side to which the first acceleration presses.

    pressed: (T,) acceleration with which the torque presses the joint to one side [rad/s^2]
    step:    time between samples [s]
    play:    width of the play [rad]
    """
    side, begin = 1.0 if pressed[0] >= 0.0 else -1.0, 0
    found, away = np.empty(len(pressed)), {1.0: np.flatnonzero(pressed < 0.0), -1.0: np.flatnonzero(pressed > 0.0)}
    while begin < len(pressed):
        ahead = away[side][np.searchsorted(away[side], begin) :]
        leaves = int(ahead[0]) if len(ahead) else len(pressed)
        found[begin:leaves] = side
        moved = _moved(-side * pressed[leaves:] * step**2, play)
        begin = leaves + len(moved)
        if len(moved) and moved[-1] >= play:  # it has crossed, and is now pressed to the other side
            found[leaves:begin], side = side * (1.0 - 2.0 * np.minimum(moved, play) / play), -side
        else:
            found[leaves:begin] = side * (1.0 - 2.0 * np.maximum(moved, 0.0) / play)
    return found


def _moved(pressed: Array, play: float) -> Array:
    """Return the travel (n,) [rad] away from one side, from rest, until the play is crossed or the joint is back.

    It has a value for each step up to that one, so that n <= T; n = T where neither happens.

    pressed: (T,) acceleration away from that side, times the square of the time between samples [rad]
    play:    width of the play [rad]
    """
    moved = np.zeros(0)
    for count in (64, 1024, len(pressed)):
        moved = np.cumsum(np.cumsum(pressed[:count]))
        ends = np.flatnonzero((moved >= play) | (moved <= 0.0))
        if len(ends):
            return np.asarray(moved[: ends[0] + 1])
    return moved
