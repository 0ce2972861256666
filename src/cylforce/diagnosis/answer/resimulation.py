"""The blocks `[[effects]]` of a patch, switched on in the identified machine, which is led along the recorded motion:
what its sensors would have read, and what is left of what they read.

The blocks are read as the simulated machine reads them (`effects/imposed.py`), so that a wrong unit, sign,
place or time shows. The true motion is the one that the sensors' errors turn into the recorded one. Torques are
compared filtered alike, by momentum and static half: nothing is differentiated twice. What rubs by force rubs by the
measured one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from cylforce.diagnosis.columns.problem import Seen
from cylforce.diagnosis.columns.recorded import GapRows
from cylforce.diagnosis.columns.riding import Carried, quiet
from cylforce.diagnosis.columns.rows import Viewer
from cylforce.effects.imposed import (
    Imposed,
    added_parameters,
    altered,
    base_motions,
    changed_laws,
    changed_load,
    contact_force,
    excess_force,
    excess_torque,
    friction_level,
    imposed,
    undistorted,
    unseen_slew,
)
from cylforce.effects.library import LIBRARY, Group
from cylforce.effects.loads.carried import CarriedLoad
from cylforce.effects.loads.slew import Slew
from cylforce.effects.loads.tip_force import tip_torque
from cylforce.estimation.observation import unusable
from cylforce.estimation.regressor import Regressor
from cylforce.mechanics.machine import Machine
from cylforce.mechanics.motion import Motion
from cylforce.signals.estimate import Array

LIGHTEST = 1e-9  # kg: what a load that is none is divided by


def read_blocks(
    machine: Machine, blocks: Sequence[Mapping[str, Any]], library: tuple[Group, ...] = LIBRARY
) -> tuple[Imposed, ...]:
    """The effects of a patch's blocks. Raises ValueError, in a sentence."""
    return tuple(
        imposed(
            *(machine, block["name"], block["at"], block["value"]),
            shape=block.get("shape"),
            begin=block.get("from_s", 0.0),
            end=block.get("until_s", np.inf),
            library=library,
        )
        for block in blocks
    )


@dataclass(frozen=True)
class Resimulation:
    """A viewer's machine with `effects`; `parameters` (P,): its own with what it carries; `carried` (4,): mass [kg],
    first moments x, z [kg m] and moment of inertia [kg m^2] about the last pin of that."""

    viewer: Viewer
    effects: tuple[Imposed, ...]
    parameters: Array
    carried: Array

    def seen(self, seen: Seen) -> Seen:
        """A recording with its rows as this machine explains them: `base`, `rockers` and `left` along the true motion;
        all other columns stay as they were. Raises ValueError where the machine cannot do so, in a sentence."""
        if not self.effects:
            return seen
        rate = self.viewer.model.filters.rate_hz
        t = seen.recorded.begins + np.arange(len(seen.recorded.values)) / rate
        values = undistorted(self.viewer.weighed, self.effects, seen.recorded.values, t)
        return seen._replace(rows=self._rows(seen, values))

    @cached_property
    def _other(self) -> Viewer:
        model = self.viewer.model
        return Viewer(replace(model, machine=altered(model.machine, self.effects)), self.viewer.tares)

    def _rows(self, seen: Seen, values: Array) -> GapRows:
        other, late, size = self._other, slice(self.viewer.slow.settle_steps, None), len(self.parameters)
        moved = other.slow.channels.run(other.thinned(values))
        steps = np.arange(len(moved.usable), dtype=np.float64)
        t = seen.recorded.begins + (steps - 0.5) / other.slow.filters.rate_hz - other.channel_lag
        rows = other.regressor.run(moved.motion)
        base, rockers = rows.columns[..., :size], rows.columns[..., size:]
        left = rows.torque - base @ other.tares - other.regressor.filtered(*self._excess(moved.motion, values, t))
        left -= np.einsum("trp,tp->tr", base, self._added(t - other.filter_lag))
        lost = np.isnan(seen.rows.left) | unusable(other.slow, moved)[late]
        left = np.where(lost, np.nan, left[late])
        return seen.rows._replace(base=base[late].copy(), rockers=rockers[late].copy(), left=left)

    def _added(self, t: Array) -> Array:
        """What the parameters have in excess (T, P) at times (T,): links' masses, friction, and the load's change."""
        machine, (mass, x, z, inertia) = self._other.slow.machine, self.carried
        found = np.zeros((len(t), len(self.parameters)))
        found[:, : 3 * machine.size] = added_parameters(machine, self.effects, t).reshape(len(t), -1)
        for k, more in self._rubbing(t).items():
            found[:, k] += more * self.parameters[k]
        centre = np.array([x, z]) / max(mass, LIGHTEST)
        before = CarriedLoad(np.full(len(t), mass), np.tile(centre, (len(t), 1)), np.full(len(t), inertia))
        after = changed_load(self.effects, before, t)
        change = [np.column_stack([c.mass, c.mass[:, None] * c.centre, c.inertia]) for c in (before, after)]
        return np.asarray(found + (change[1] - change[0]) @ self._other.slow.load.T)

    def _rubbing(self, t: Array) -> dict[int, Array]:
        """By how much the parameters of friction grow, as a share (T,), by their number."""
        cylinders, names = self._other.slow.machine.cylinders, [p.name for p in self._other.slow.parameters]
        return {
            names.index(f"{cylinder.name}.{law}"): friction_level(self.effects, len(cylinders), t, law)[:, c] - 1.0
            for law in changed_laws(self.effects)
            for c, cylinder in enumerate(cylinders)
            if f"{cylinder.name}.{law}" in names
        }

    def _excess(self, moving: Motion, values: Array, t: Array) -> tuple[Array, Array]:
        """Momentum and static torque (T, R) of what the machine has besides, at times (T,)."""
        machine = self._other.slow.machine
        static = np.einsum("tcn,tc->tn", moving.lever, excess_force(self.effects, moving, t))
        static += excess_torque(machine, self.effects, moving, t)
        static += tip_torque(machine, moving, contact_force(self.effects, t))
        static += self._turning(moving, t)
        momentum, riding = self._riding(moving, values, t)
        return momentum, static[:, machine.rows] + riding

    def _turning(self, moving: Motion, t: Array) -> Array:
        """What a slew that no sensor tells asks of the joints (T, N); it adds to the square of the rate."""
        unseen, machine = unseen_slew(self.effects, t), self._other.slow.machine
        if not np.any(unseen):
            return np.zeros_like(moving.q)
        names = [p.name for p in Slew().parameters(machine)]
        known = dict(zip((p.name for p in self._other.slow.parameters), self.parameters.tolist(), strict=True))
        columns = Slew().halves(machine, moving._replace(slew=np.ones_like(moving.slew))).static
        return np.asarray(unseen[:, None] * (columns @ np.array([known.get(name, 0.0) for name in names])))

    def _riding(self, moving: Motion, values: Array, t: Array) -> tuple[Array, Array]:
        """Momentum and static torque (T, R) of a base that moves as its pitch tells."""
        model, found = self._other.slow, np.zeros((2, len(t), len(self._other.slow.machine.rows)))
        for effect, each in base_motions(self.effects):
            still = quiet(model.machine, values, self.viewer.model.filters.rate_hz)
            turning = model.channels.turning(self._other.thinned(still))
            carried = Carried(effect, turning, self.parameters[: 3 * model.machine.size].reshape(-1, 3))
            halves = Regressor(model.machine, (carried,)).products(moving, np.array(each.sizes))
            found += each.during(t)[:, None] * np.array(halves)
        return found[0], found[1]
