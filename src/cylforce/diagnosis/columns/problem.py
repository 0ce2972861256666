"""The question put to the evidence: recordings, clean and faulty, as blocks of columns, and every term that might be in
the faulty ones alone."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cylforce.diagnosis.columns.recorded import GapRows, Recorded
from cylforce.diagnosis.columns.returns import Returns
from cylforce.diagnosis.columns.riding import Riding, riding
from cylforce.diagnosis.columns.rows import BLOCK, CENTRE, ROCKER, Viewer
from cylforce.effects.fault import INCIDENTAL, SHAPES, TORQUES
from cylforce.effects.library import Proposal
from cylforce.effects.loads.rocker_weight import RockerWeight
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array

WAVES = (1.0, 0.6, 0.5, 0.35, 0.25, 0.2)  # usual level, slope, bend, ... of what an incident changes within a block
UNUSUAL = (500.0, 300.0, 300.0, 600.0, 0.05, *(w * x for w in WAVES for x in (8e3, 8e3, 0.3)))  # usual sizes of those
TORQUE = 5e3  # N m, the same of a torque of which nothing is known
SHEET = 0.01  # of that, where only a data sheet is known: beyond it, its errors count as effects
GROWTH_S = 100.0  # in which a clock that runs off is late by the second of its sizes


class Seen(NamedTuple):
    """A recording and its rows."""

    recorded: Recorded
    rows: GapRows


class Identified(NamedTuple):
    """Accuracy of an identification, as identified.toml states it.

    covariance:  (P, P) of the model's parameters. Their errors are strongly correlated: taken one by one they would
                 leave the torques tens of noise floors uncertain.
    unexplained: (R,) residual torque [N m, rms], the noise floor
    """

    covariance: Array
    unexplained: Array


def looked_at(viewer: Viewer, group: Sequence[Recorded | Seen], wanted: Sequence[Proposal]) -> tuple[Seen, ...]:
    """Recordings with their rows; those that have them keep them, if they were computed for the same proposals."""
    return tuple(r if isinstance(r, Seen) else Seen(r, viewer.rows(r, wanted).slim) for r in group)


@dataclass(frozen=True)
class Problem:
    """Recordings seen by one model, whose parameters are known to `known` (P,) standard errors, with one library."""

    model: Model
    known: Array
    proposals: tuple[Proposal, ...]
    clean: tuple[Seen, ...]
    faulty: tuple[Seen, ...]
    tares: Array | None = None  # (P,) values of the model's parameters, if it was identified
    base: Riding | None = None  # how the base moves, if it is known already
    identified: Identified | None = None  # without references: what the identification determined

    @property
    def floor_known(self) -> bool:
        """Whether the noise floor comes from other recordings than the faulty ones, references or an identification."""
        return bool(self.clean) or self.identified is not None

    @property
    def from_sheet(self) -> bool:
        """Whether nobody identified the machine: a data sheet knows masses roughly and friction not at all."""
        return not self.model.friction

    @property
    def at_work(self) -> float:
        """The share of the usable rows that are work, of the clean recording in which it is least; 0 without any."""
        work, rest = Counter[str](), Counter[str]()  # rows: a recording may be here in parts
        for seen in self.clean:
            counts = seen.recorded.counts
            work[seen.recorded.name] += 0 if counts is None else int(np.sum(~counts))
            rest[seen.recorded.name] += int(np.sum(np.any(np.isfinite(seen.rows.left), axis=1)))
        return min(
            (work[name] / (work[name] + count) for name, count in rest.items() if work[name] + count), default=0.0
        )

    def of_load(self, seen: Seen) -> int | None:
        """The first of the columns of a recording's load beyond its mass; None for an empty one."""
        place = self._loaded.index(self._recording(seen)) if seen.recorded.load else None
        return None if place is None else len(self.model.parameters) + len(CENTRE) * place

    @property
    def of_the_field(self) -> list[int]:
        """The columns that only the field tells: where its loads hang, and how a base that always moved goes (clean
        recordings, on another slope, tell little of that)."""
        loads = dict.fromkeys(place for seen in self.faulty if (place := self.of_load(seen)) is not None)
        rides = range(self.first - len(self._ridden), self.first) if self.riding.always and not self.riding.more else ()
        return [*(place + i for place in loads for i in range(len(CENTRE))), *rides]

    @cached_property
    def _ridden(self) -> list[tuple[int, float]]:
        """The columns of motions of the base, counted from the first effect's, and their usual sizes."""
        each = [(p.rides, size) for p in self.proposals for size in p.usual]
        return [(k, size) for k, (rides, size) in enumerate(each) if rides]

    @cached_property
    def riding(self) -> Riding:
        """How the base moves."""
        return self.base or riding(*([seen.rows.turning for seen in group] for group in (self.clean, self.faulty)))

    def _base_moves(self, seen: Seen) -> tuple[float, float]:
        """By what the columns of how the base always moved, and those of its motion as an effect, are multiplied: in
        faulty recordings it is either the one or the other."""
        clean = any(seen.recorded is other.recorded for other in self.clean)
        own = self.riding.always and (clean or not self.riding.more)
        return float(own), float(self.riding.more and not clean)

    @cached_property
    def _loaded(self) -> list[tuple[bool, str]]:
        """Recordings with a load: it hangs in all stretches of one alike."""
        return list(dict.fromkeys(self._recording(seen) for seen in (*self.clean, *self.faulty) if seen.recorded.load))

    def _recording(self, seen: Seen) -> tuple[bool, str]:
        """Of which recording a stretch is: whether of a clean one, and its name."""
        return any(seen is other for other in self.clean), seen.recorded.name

    @cached_property
    def spread(self) -> Array:
        """Standard errors (K,) of all columns' sizes beforehand."""
        effects = [size for p in self.proposals for size in p.usual]
        return np.concatenate([self.known, self._own, effects, self.unusual])

    @cached_property
    def _own(self) -> Array:
        """Of what loads, linkages' bars and the base's usual motion have."""
        bars = 0 if "rocker" in self.model.friction else len(RockerWeight().parameters(self.model.machine))
        loads, rides = np.tile(CENTRE, len(self._loaded)), [size for _, size in self._ridden]
        return np.concatenate([loads, np.full(bars, ROCKER * (SHEET if self.from_sheet else 1.0)), rides])

    @cached_property
    def always(self) -> Array:
        """The same of what the machine always was: of effects, what goes unnoticed."""
        effects = [size for p in self.proposals for size in p.unnoticed]
        return np.concatenate([self.known, self._own, effects, self.unusual])

    @cached_property
    def first(self) -> int:
        """The number of the first effect's column."""
        return len(self.model.parameters) + len(self._own)

    @cached_property
    def lasting(self) -> int:
        """Number of columns before those of incidents."""
        return len(self.spread) - len(self.unusual)

    @cached_property
    def mechanical(self) -> list[int]:
        """The columns of the machine itself, in which no reading of a sensor stands for itself: the model's parameters,
        and of every law of friction of the library the first form at each cylinder: others are sums of these, or
        nearly."""
        seen, found, k = set[tuple[str, str]](), [*range(self.first)], self.first
        for p in self.proposals:
            if p.rubs and (p.name, p.at) not in seen:
                seen.add((p.name, p.at))
                found += range(k, k + len(p.usual))
            k += len(p.usual)
        return found

    @property
    def of_the_floor(self) -> Sequence[int]:
        """The columns that are fitted before a residual counts as noise: those of the machine itself. Without clean
        recordings all that last: the faulty ones hold the effects that are sought, which must not count as noise."""
        return self.mechanical if self.clean else range(self.lasting)

    @cached_property
    def unusual(self) -> Array:
        """Usual sizes (I,) of what incidents change."""
        return np.concatenate([UNUSUAL, np.tile(TORQUE * np.array(WAVES), len(self.model.machine.rows))])

    @cached_property
    def places(self) -> tuple[tuple[int, ...], ...]:
        """The columns of every proposal."""
        found, k = [], self.first
        for p in self.proposals:
            found.append(self._incidental(p) if p.course else tuple(range(k, k + len(p.usual))))
            k += len(p.usual)
        return tuple(found)

    def _incidental(self, p: Proposal) -> tuple[int, ...]:
        if p.incidents == TORQUES:
            first = self.lasting + len(INCIDENTAL) + SHAPES * self.model.machine.rows.index(p.where)
            return tuple(range(first, first + SHAPES))
        return tuple(self.lasting + INCIDENTAL.index(name) for name in p.incidents)

    def columns(self, seen: Seen) -> Array:
        """[base | loads | bars | base's motion | effects | incidents | left] (T, R, K+1) of a recording; a known load
        is taken off."""
        rows, own = seen.rows, np.zeros((*seen.rows.left.shape, len(CENTRE) * len(self._loaded)))
        left = rows.left
        first = self.of_load(seen)
        if first is not None:
            each = rows.base @ self.model.load
            left = left - each[..., 0] * seen.recorded.load
            k = first - len(self.model.parameters)
            own[..., k : k + len(CENTRE)] = each[..., 1:]
        chosen = [k for k, _ in self._ridden]
        rides = rows.effects[..., chosen]
        parts = (rows.base, own, rows.rockers, rides, rows.effects, rows.incidental, left[..., None])
        found = np.concatenate(parts, axis=-1)
        always, more = self._base_moves(seen)
        found[..., self.first - len(chosen) : self.first] *= always
        found[..., [self.first + k for k in chosen]] *= more
        return found

    @cached_property
    def returns(self) -> Returns:
        """What return pressures say."""
        return Returns(self.model.machine, self.clean, self.faulty, self.model.filters.rate_hz)

    @cached_property
    def spans(self) -> list[tuple[int, int]]:
        """First block and the one after the last, of every faulty recording."""
        ends = np.cumsum([0] + [-(-len(seen.rows.t) // BLOCK) for seen in self.faulty]).tolist()
        return list(pairwise(ends))

    @cached_property
    def times(self) -> Array:
        """Time (B,) [s] of the middle of every faulty block."""
        return np.concatenate([seen.rows.t[::BLOCK] + _half(seen.rows.t) for seen in self.faulty])

    def largest(self, proposal: Proposal) -> float:
        """The largest plausible size of an effect on this machine."""
        high, share = proposal.about.high, proposal.of_dry
        return min(share * self._dry[proposal.where], high) if share and self._dry else high

    @cached_property
    def _dry(self) -> tuple[float, ...]:
        """Known dry friction [N] of every cylinder in the faulty recordings; none where nobody identified it."""
        if self.tares is None or "coulomb" not in self.model.friction:
            return ()
        sizes = {q.name: size for q, size in zip(self.model.parameters, self.tares.tolist(), strict=True)}
        load = np.nanmean(np.abs(np.concatenate([seen.rows.force for seen in self.faulty])), axis=0)
        each = zip(self.model.machine.cylinders, load.tolist(), strict=True)
        dry = (sizes.get(f"{c.name}.coulomb", 0.0) + sizes.get(f"{c.name}.load_dependent", 0.0) * f for c, f in each)
        return tuple(max(force, 0.0) for force in dry)


def _half(t: Array) -> float:
    return float(t[1] - t[0]) * BLOCK / 2.0 if len(t) > 1 else 0.0
