"""Search for the most probable hypotheses.

All forms are screened at once. A small beam of hypotheses with more and more effects follows. The best ones are
examined again with their columns at the magnitudes found, and with their shape parameters refined.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cylforce.diagnosis.constants import (
    CARRY_BACK,
    FEW_BLOCKS,
    INCIDENT,
    INCIDENT_SIZES,
    OIL_CHANGE,
    OWN_OIL_CHANGE,
    PAYLOAD,
    POLYNOMIALS,
    SAME_MACHINE,
    SECOND_EFFECT,
    SPILL,
    THERMAL_ZERO,
)
from cylforce.diagnosis.likelihood import (
    FREE_PRECISION,
    USUAL_CONDITIONS,
    Conditions,
    Form,
    FreeStretch,
    Hypothesis,
    Likelihood,
    Losses,
    MachineKnowledge,
    MarginalLikelihood,
    Nuisance,
    Payload,
    TemperatureChange,
    effective_share,
    free_stretches,
    likeliest_noise,
    log_evidence,
    log_of_other_rows,
    log_prior_of_blocks,
    symmetric_positive,
)
from cylforce.diagnosis.model import (
    CENTRE,
    GROWTH_S,
    HealthyMachine,
    KnowledgeSource,
    Seen,
    form_of,
    forms_of,
    lasting,
)
from cylforce.diagnosis.regressors import ColumnSource, ReturnLevel, return_evidence, return_levels
from cylforce.diagnosis.statistics import Blocks, Gram, Mask, SharedNoise
from cylforce.effects.effect import Parameter
from cylforce.effects.fault import BEYOND, INCIDENTAL, Place, TimeCourse, shaped, shapes
from cylforce.effects.imposed import Imposed
from cylforce.effects.incidents.payload_spill import PayloadSpill
from cylforce.effects.library import Group, Proposal
from cylforce.effects.loads.tip_force import TipForce
from cylforce.effects.unknown import NAME as UNKNOWN_TORQUE
from cylforce.estimation.model import Model
from cylforce.readings.constants import BLOCK_ROWS, HEALTHY, LOAD_CENTRE, UNKNOWN_EFFECT
from cylforce.readings.zeros import NAME as OFFSET
from cylforce.readings.zeros import Zero
from cylforce.signals.estimate import Array

Key = tuple[str, str]  # name and place of an effect
NO_GAP: Key = ("no_gap", "")
UNKNOWN: Key = ("unknown", "")
CONTACT = TipForce().about.name
GLITCH = "intermittent_glitch"
STEP_COLUMNS = ("load.mass", "load.X", "load.Z")
WIDTH, DEEPEST, REFINED = 2, 8, 8  # of the beam: hypotheses kept, effects at most, forms tried beside each
AGAIN = 6  # hypotheses whose columns are computed again at their magnitudes
CORRECTIONS = 6  # rounds of columns at the magnitudes found, at most: noise in a column delays their end
COARSE = (0.1, 0.5, 0.9)  # positions of a shape parameter in its range that are tried first
STEP_OF_SHAPE, FINER = 0.2, 2  # of its range; rounds, each at half the distance
NEAR_SHAPE = 0.03  # of its range: nearer positions are the same
SHAPED = 3  # candidates whose shape is refined
STILL = 0.03  # of a magnitude: a smaller change of it does not bend its columns
KEPT_ROWS = 0.5  # of the rows, that must stay usable when a recording is corrected
SETTLING = 4  # rounds in which the blocks of an incident are found


@dataclass(frozen=True)
class LoadStep:
    """Change of a known load to another one.

    first: block in which it changes, among all blocks; it does not count
    last:  block before which the other load ends
    """

    first: int
    last: int


@dataclass(frozen=True)
class Applied:
    """Effect for which recordings are corrected.

    proposal: the effect
    sizes:    (M,) its sizes [SI]
    """

    proposal: Proposal
    sizes: Array

    @property
    def imposed(self) -> Imposed:
        """The effect in the format of the simulated machine."""
        sizes = self.sizes / np.array([1.0, GROWTH_S]) if self.proposal.clock else self.sizes
        return Imposed(self.proposal.group, self.proposal.at, self.proposal.where, tuple(sizes.tolist()))


@dataclass(frozen=True)
class Refined:
    """Effect with refined shape parameters.

    proposal: the effect with the refined shape
    columns:  (T, R, M) its columns along each recording
    added:    (T', R, M) change of its columns from sensor noise added to each recording's beginning
    """

    proposal: Proposal
    columns: tuple[Array, ...]
    added: tuple[Array, ...]

    @property
    def unit(self) -> Array:
        """Typical sizes (M,) of its columns."""
        return np.array(self.proposal.usual)


# Computed properties of a question, which another question with the same rows, or from the same readings, has as well.
OF_ROWS = ("blocks", "spans", "_whole_gram", "_return_levels")
OF_READINGS = ("_return_levels", "_supports", "_gram_as_read", "knowledge")
# What a candidate needs of its question; the rows of a corrected recording take tens of megabytes.
OF_CANDIDATES = ("applied", "noise", "refined", "forms", "times", "spans", *OF_READINGS)


@dataclass(frozen=True)
class FieldQuestion:
    """Recordings under diagnosis, compared with a healthy machine.

    machine:          the healthy machine
    as_read:          the recordings, with the shared sensor noise of each
    step:             possible change of a known load
    laid:             rows of each recording that count, in whole blocks; None: all rows
    apart:            log probability of the rows that do not count
    correction:       effects for which the readings are corrected, each with the number of its form; None: as read
    jumps:            evidence [nats] of the number of jumps of a reading, by its signal
    zeros:            readings of pressure sensors without pressure, by their signals
    free:             whether the model's parameters are free, because they may be another machine's
    same_oil:         whether the oil is certainly as warm as in the references
    refined_as_read:  an effect with refined shape parameters, whose columns are appended; None if there is none
    """

    machine: HealthyMachine
    as_read: tuple[Seen, ...]
    step: LoadStep | None = None
    laid: tuple[NDArray[np.int_] | None, ...] | None = None
    apart: float = 0.0
    correction: tuple[tuple[int, Applied], ...] | None = None
    jumps: Mapping[int, float] = field(default_factory=dict)
    zeros: Mapping[int, Zero] = field(default_factory=dict)
    free: bool = False
    same_oil: bool = False
    refined_as_read: Refined | None = None

    @cached_property
    def seen(self) -> tuple[Seen, ...]:
        """The recordings, corrected."""
        return self._corrected.seen

    @cached_property
    def noise(self) -> Array | None:
        """Energy (R, 1 + POLYNOMIALS) of the sensor noise that the correction removed; None of readings as read."""
        return self._corrected.noise

    @cached_property
    def refined(self) -> Refined | None:
        """Effect with refined shape parameters, its columns along the corrected recordings."""
        return self._corrected.refined

    @cached_property
    def applied(self) -> dict[int, Array]:
        """Sizes for which the recordings are corrected, in units of the typical ones, by form."""
        return {p: a.sizes / self.unit_of(p) for p, a in self.correction or ()}

    @cached_property
    def loaded(self) -> list[str]:
        """Names of the recordings with a known load."""
        return list(dict.fromkeys(s.recording.name for s in self.as_read if s.recording.load_kg))

    @cached_property
    def size(self) -> int:
        """K', number of columns: those of the machine, the centre of each load, the change of a load."""
        return self.machine.layout.size + CENTRE * len(self.loaded) + (len(STEP_COLUMNS) if self.step else 0)

    @cached_property
    def unit(self) -> Array:
        """Typical sizes (K',) of the columns."""
        step = self._step_unit if self.step else np.zeros(0)
        return np.concatenate([self.machine.layout.unit, np.tile(LOAD_CENTRE, len(self.loaded)), step])

    @property
    def _step_unit(self) -> Array:
        return self.machine.layout.typical[[INCIDENTAL.index(name) for name in STEP_COLUMNS]]

    @cached_property
    def blocks(self) -> list[Blocks]:
        """Whitened rows of the recordings with columns [K' | incidental | residual]."""
        layout, first, found = self.machine.layout, 0, []
        for n, seen in enumerate(self.seen):
            blocks, rows, usable = seen.blocks, seen.blocks.rows, seen.blocks.usable
            load = rows[..., layout.size : layout.size + 1 + CENTRE]
            centres = [
                load[..., 1:] * np.float32(name == seen.recording.name and seen.recording.load_kg > 0.0)
                for name in self.loaded
            ]
            parts, number = [rows[..., : layout.size], *centres], first + np.arange(len(rows))
            if self.step:
                on = (number > self.step.first) & (number < self.step.last)
                parts.append(load[..., [0, 1, 2]] * on[:, None, None, None].astype(np.float32))
                usable = usable & (number != self.step.first)[:, None, None]
            if len(parts) > 1:
                whole = np.concatenate([*parts, rows[..., layout.size :]], axis=-1) * usable[..., None]
                blocks = Blocks(np.asarray(whole, dtype=np.float32), usable)
            layed = None if self.laid is None else self.laid[n]
            found.append(blocks if layed is None else blocks.laid(layed))
            first += len(rows)
        return found

    @cached_property
    def spans(self) -> list[tuple[int, int]]:
        """First block of each recording and the one after the last."""
        ends = np.cumsum([0] + [len(s.blocks.rows) for s in self.as_read]).tolist()
        return list(pairwise(ends))

    @cached_property
    def times(self) -> Array:
        """Time (B,) [s] of the middle of every block."""
        half = BLOCK_ROWS / self.machine.regressors.rows_hz / 2.0
        return np.concatenate([s.rows.t[::BLOCK_ROWS] + half for s in self.as_read])

    @cached_property
    def forms(self) -> tuple[Form, ...]:
        """Forms of all lasting effects that may be a cause; a change of load has columns only with a step."""
        found = []
        own = forms_of(self.machine.layout, self.dry_friction)
        first = self.size - len(STEP_COLUMNS)
        for form, p in zip(own, lasting(self.machine.layout), strict=True):
            stepped = p.course is TimeCourse.AFTER and self.step is not None
            columns = tuple(first + STEP_COLUMNS.index(name) for name in p.incidents) if stepped else form.columns
            found.append(replace(form, columns=columns))
        if self.refined_as_read:
            more = tuple(range(self.size, self.size + len(self.refined_as_read.unit)))
            found.append(form_of(self.machine.layout, self.refined_as_read.proposal, more, self.dry_friction))
        return tuple(found)

    @cached_property
    def proposals(self) -> list[Proposal]:
        """Proposals of the forms."""
        more = [self.refined_as_read.proposal] if self.refined_as_read else []
        return [*lasting(self.machine.layout), *more]

    @cached_property
    def dry_friction(self) -> Array | None:
        """Modelled dry friction (C,) [N] of the cylinders in these recordings; None without a Coulomb law."""
        model, values = self.machine.regressors.model, self.machine.regressors.parameters
        if "coulomb" not in model.friction:
            return None
        known = dict(zip((p.name for p in model.parameters), values.tolist(), strict=True))
        load = np.nanmean(np.abs(np.concatenate([s.rows.force for s in self.seen])), axis=0)
        each = [
            known.get(f"{c.name}.coulomb", 0.0) + known.get(f"{c.name}.load_dependent", 0.0) * f
            for c, f in zip(model.machine.cylinders, load.tolist(), strict=True)
        ]
        return np.asarray(np.maximum(np.array(each), 0.0))

    @cached_property
    def incident_forms(self) -> Counter[str]:
        """Number of forms of each incident of single blocks, by its name; a free torque is no effect."""
        incidents = (p.name for p in self.machine.layout.proposals if p.course is TimeCourse.WINDOWS)
        return Counter(name for name in incidents if name != UNKNOWN_TORQUE)

    def unit_of(self, form: int) -> Array:
        """Return the typical sizes (M,) of a form's columns."""
        if self.refined_as_read is not None and form == len(self.proposals) - 1:
            return self.refined_as_read.unit
        return np.asarray(self.unit[list(self.forms[form].columns)])

    def gram(self, kept: Mask | None = None) -> Gram:
        """Return the Gram of the recordings.

        kept: blocks (B,) that count; None: all
        """
        if kept is None:
            found = self._whole_gram
        elif 2 * np.count_nonzero(kept) > len(kept):  # the blocks left out are fewer
            found = self._whole_gram.remainder(self._gram_of(~kept))
        else:
            found = self._gram_of(kept)
        return found if self.noise is None else found.with_noise(self.noise)

    @cached_property
    def _whole_gram(self) -> Gram:
        if not self._has_same_rows:
            return self._gram_of(None)
        changed = [k for k in range(self.size + 1) if k not in self._kept_columns]
        return self._gram_as_read.with_columns(self.blocks, changed, self.unit, self._shared_noises)

    @cached_property
    def _gram_as_read(self) -> Gram:
        """Gram of the recordings without a correction."""
        return self._whole_gram if self.correction is None else replace(self, correction=None).gram()

    @property
    def _has_same_rows(self) -> bool:
        """Whether the recordings are corrected and have the same usable rows as before."""
        pairs = zip(self.as_read, self.seen, strict=True)
        return self.correction is not None and all(np.array_equal(a.blocks.usable, b.blocks.usable) for a, b in pairs)

    @property
    def _shared_noises(self) -> list[SharedNoise]:
        """Noise of each recording that its columns share with the residual."""
        return [self._padded(seen.shared(range(self.machine.layout.size))) for seen in self.seen]

    def _gram_of(self, kept: Mask | None) -> Gram:
        parts, first = [], 0
        for noise, blocks in zip(self._shared_noises, self.blocks, strict=True):
            mask = None if kept is None else kept[first : first + len(blocks.rows)]
            first += len(blocks.rows)
            own = blocks if mask is None else blocks.masked(mask)
            parts.append(Gram.of(own, range(self.size), self.unit, noise))
        return Gram.total(parts)

    def _padded(self, noise: SharedNoise) -> SharedNoise:
        if not len(noise.products):
            return SharedNoise.none(len(self.machine.floor.rms), self.size + 1)
        found = np.zeros((*noise.products.shape[:-1], self.size + 1))
        own = self.machine.layout.size
        found[..., :own], found[..., -1] = noise.products[..., :own], noise.products[..., -1]
        return SharedNoise(found, noise.counts)

    @cached_property
    def knowledge(self) -> MachineKnowledge:
        """Statistics of the healthy machine with the columns that only these recordings have.

        The variance of the model's parameters is increased by one where they are free.
        """
        own, more = self.machine.machine, self.size - self.machine.layout.size
        covariance = np.zeros((self.size, self.size))
        covariance[: len(own.mean), : len(own.mean)] = own.covariance
        if self.free:
            count = len(self.machine.regressors.parameters)
            covariance[:count, :count] += np.eye(count)
        for k in range(CENTRE * len(self.loaded)):
            covariance[len(own.mean) + k, len(own.mean) + k] = 1.0
        pad = np.zeros(more)
        change = None
        if not self.free and self.machine.source.has_temperature:
            change = self.temperature_change.padded(more)
            change = replace(change, friction=None) if self.same_oil else change
        return MachineKnowledge(np.append(own.mean, pad), covariance, np.append(own.variation, pad), own.noise, change)

    @cached_property
    def temperature_change(self) -> TemperatureChange:
        """Change of the healthy machine at another temperature, in typical sizes of the columns.

        The friction of all cylinders changes together, also in the course of the recording, and each a little by
        itself. The magnitude of a law is known better for all cylinders together than for one: it is divided by piston
        area.
        """
        regressors, unit = self.machine.regressors, self.machine.layout.unit
        values = regressors.parameters + self.machine.values[: len(regressors.parameters)]
        areas = {c.name: c.area_head for c in regressors.model.machine.cylinders}
        friction, zeros = np.zeros((len(unit), len(unit))), np.zeros(len(unit))
        for law, relative in OIL_CHANGE.items():
            area = {k: areas[p.name.rpartition(".")[0]] for k, p in _named(regressors.model, law)}
            magnitude, change = sum(abs(float(values[k])) for k in area), np.zeros(len(unit))
            for k, own in area.items():
                change[k] = relative * magnitude * own / sum(area.values()) / unit[k]
            if law != "directional":  # a difference between the directions may grow either way
                friction += np.outer(change, change)
            friction += np.diag(np.square(OWN_OIL_CHANGE * change))
        warming = sum(p.is_warming for p in self.machine.layout.proposals)  # forms of it, each with a time constant
        for p, columns in zip(self.machine.layout.proposals, self.machine.layout.places, strict=True):
            if p.name == OFFSET:
                zeros[list(columns)] = THERMAL_ZERO / unit[list(columns)]
            elif p.is_warming:  # all forms together have the variance of one
                at = list(columns)
                friction[at, at] = np.square(p.unnoticed / unit[at]) / warming
        return TemperatureChange(np.diag(np.square(zeros)), friction)

    def with_refined(self, refined: Refined | None) -> "FieldQuestion":
        """Return the question with an effect whose shape is refined, its columns appended; None: without one."""
        return self._keeping(replace(self, refined_as_read=refined), *OF_ROWS, "knowledge")

    def with_same_oil(self) -> "FieldQuestion":
        """Return the question of a machine whose oil is certainly as warm as in the references."""
        return self._keeping(replace(self, same_oil=True), *OF_ROWS)

    def with_free_parameters(self, values: Array) -> "FieldQuestion":
        """Return the question with parameters as uncertain as those of the data sheet.

        values: (P,) change of the reported parameters [SI]
        """
        whole = self.machine.values.copy()
        whole[: len(values)] += values
        return self._keeping(replace(self, machine=replace(self.machine, values=whole), free=True), *OF_ROWS)

    def without_rows(self) -> "FieldQuestion":
        """Return the question without the rows of a correction, which are computed again if they are needed."""
        return self if self.correction is None else self._keeping(replace(self), *OF_CANDIDATES)

    def _keeping(self, other: "FieldQuestion", *names: str) -> "FieldQuestion":
        """Return another question with some computed properties of this one, which are the same in both."""
        other.__dict__.update({name: getattr(self, name) for name in names})
        return other

    def likelihood(self, kept: Mask | None = None) -> Likelihood:
        """Return the likelihood of the recordings, or of some of their blocks (B,)."""
        gram, unit, knowledge = self.gram(kept), self.unit, self.knowledge
        if self.refined is not None:
            blocks, first = [], 0
            for each in self.blocks:
                count = len(each.rows)
                blocks.append(each if kept is None else each.masked(kept[first : first + count]))
                first += count
            gram = gram.extended(blocks, range(self.size), self._refined_blocks(kept), unit, self.refined.unit)
            unit, zero = np.append(unit, self.refined.unit), np.zeros(len(self.refined.unit))
            covariance = np.zeros((len(unit), len(unit)))
            covariance[: self.size, : self.size] = knowledge.covariance
            mean, variation = np.append(knowledge.mean, zero), np.append(knowledge.variation, zero)
            change = knowledge.temperature and knowledge.temperature.padded(len(zero))
            knowledge = MachineKnowledge(mean, covariance, variation, knowledge.noise, change)
        return Likelihood(
            gram, unit, self.forms, knowledge, corrected=self.applied, support=self.evidence_for, apart=self.apart
        )

    def _refined_blocks(self, kept: Mask | None) -> list[tuple[Blocks, SharedNoise]]:
        """Return the whitened columns of the refined effect in the kept blocks, and their shared noise."""
        if self.refined is None:
            return []
        found, first, floor = [], 0, self.machine.floor
        for n, (seen, columns, added) in enumerate(
            zip(self.seen, self.refined.columns, self.refined.added, strict=True)
        ):
            blocks = Blocks.whitened(columns, floor)
            rows = None if self.laid is None else self.laid[n]
            blocks = blocks if rows is None else blocks.laid(rows)
            count = len(blocks.rows)
            noise = Blocks.whitened(added, floor)
            usable = noise.usable & seen.added.usable[: len(noise.usable)]
            both = np.concatenate([noise.rows, seen.added.rows[: len(usable), ..., -1:]], axis=-1) * usable[..., None]
            shared = SharedNoise.of(Blocks(np.asarray(both, dtype=np.float32), usable), range(added.shape[-1]))
            found.append((blocks if kept is None else blocks.masked(kept[first : first + count]), shared))
            first += count
        return found

    def evidence_for(self, form: int, sizes: Array) -> float:
        """Return the evidence [nats] for a form from return pressures, zeros and counts of jumps.

        sizes: (M,) of the form [SI]
        """
        p = self.proposals[form]
        if p.name == GLITCH:
            return self.jumps.get(p.where, 0.0)
        read = self.zeros.get(p.where) if p.name == OFFSET else None
        zero = 0.0 if read is None else read.evidence(float(sizes[0]))
        level = self._return_levels.get(p.where) if p.about.place is Place.PRESSURE else None
        if level is None:
            return zero
        size = float(f"{float(sizes[0]):.2g}")  # the evidence is smooth: it is computed once for sizes that round alike
        if (form, size) not in self._supports:
            machine, rate = self.machine.regressors.model.machine, self.machine.regressors.model.filters.rate_hz
            pairs = [(s.recording, s.rows) for s in self.seen]
            self._supports[form, size] = return_evidence(machine, level, p, size, pairs, rate)
        return zero + self._supports[form, size]

    @cached_property
    def _supports(self) -> dict[tuple[int, float], float]:
        return {}

    @cached_property
    def _return_levels(self) -> dict[int, ReturnLevel]:
        own, pairs = self.machine.regressors.model, [(s.recording, s.rows) for s in self.seen]
        return return_levels(own.machine, self.machine.returns, pairs, own.filters.rate_hz)

    def nuisance(self, columns: Sequence[int]) -> Nuisance:
        """Return the nuisance of incidental columns (numbers from the layout's K on) of all blocks."""
        shift = self.size - self.machine.layout.size
        typical = self.machine.layout.typical[[k - self.machine.layout.size for k in columns]]
        own = [k + shift for k in columns]
        return Nuisance.of(self.blocks, range(self.size), self.unit, own, typical)

    @cached_property
    def plain(self) -> Array:
        """Coefficients (K'+1,) of the reported residual: of the machine's columns and of the centres of the loads."""
        layout, found = self.machine.layout, np.zeros(self.size + 1)
        found[-1], found[: layout.size] = 1.0, -self.machine.values / layout.unit
        centres = list(range(layout.size, layout.size + CENTRE * len(self.loaded)))
        if centres:
            gram = self.gram()
            whole = np.sum(gram.whole, axis=0)
            normal = whole[np.ix_(centres, centres)] + np.eye(len(centres))
            found[centres] = -np.linalg.solve(normal, whole[centres] @ found)
        return found

    def refits(self, conditions: Conditions) -> bool:
        """Return whether columns of the machine, and not only of loads, are fitted to these recordings."""
        return bool(self._refitted_columns(conditions))

    def _refitted_columns(self, conditions: Conditions) -> list[int]:
        """Return the columns of the machine, without loads, that are fitted to these recordings.

        Parameters are fitted where they are free, or identified without references. If the oil has another temperature,
        friction and sensor zeros are fitted. Zeros are not fitted for another temperature of the sensors alone: a
        constant force turns Coulomb friction into asymmetric friction.
        """
        own, change = set[int](), self.knowledge.temperature
        if self.free or self.machine.references == 0:
            own |= set(range(self.machine.layout.first))
        if conditions.other_oil and change is not None and change.friction is not None:
            own |= set(np.flatnonzero(np.diag(change.zeros + change.friction)).tolist())
        return sorted(own)

    def beside(self, more: Array, case: Likelihood, conditions: Conditions) -> Array:
        """Return the coefficients (K'+1,) of the reported residual given the sizes of effects.

        The centres of the loads are fitted to it, and the columns of the machine that `refits` refers to.
        more:       (K'+M,) sizes of the effects' columns, those of an effect with a refined shape appended
        case:       likelihood of the blocks that count, with the same columns
        conditions: of the recordings
        """
        found, layout = self.plain.copy(), self.machine.layout
        own = [k for k in self._refitted_columns(conditions) if more[k] == 0.0]
        own += range(layout.size, layout.size + CENTRE * len(self.loaded))
        if own:
            start = np.concatenate([found[:-1], np.zeros(len(more) - self.size), found[-1:]]) - np.append(more, 0.0)
            start[own] = 0.0
            found[own] = -case.least_squares(own, start, conditions)
        return found

    def residuals(self, values: Array | None = None) -> list[Array]:
        """Return the residuals (T, R) [N m] with coefficients (K'+1,), by default the reported ones.

        Rows that were not fitted are NaN: those without a past for the whitening, and a block in which a load changes.
        """
        coefficients = self.plain if values is None else values
        layout, found = self.machine.layout, []
        for seen, span in zip(self.seen, self.spans, strict=True):
            columns = layout.columns(seen.rows, seen.recording)
            value = columns[..., -1] + columns[..., : layout.size] @ (coefficients[: layout.size] * layout.unit)
            for k, name in enumerate(self.loaded):
                if name == seen.recording.name and seen.recording.load_kg:
                    at = layout.size + CENTRE * k
                    value = value + columns[..., layout.size + 1 : layout.size + 1 + CENTRE] @ (
                        coefficients[at : at + CENTRE] * LOAD_CENTRE
                    )
            usable = seen.blocks.usable.reshape(-1, value.shape[1])[: len(value)].copy()
            if self.step and self.step.first in range(*span):
                usable[BLOCK_ROWS * (self.step.first - span[0]) :][:BLOCK_ROWS] = False
            found.append(np.where(usable, value, np.nan))
        return found

    def corrected(self, applied: Sequence[tuple[int, Applied]]) -> "FieldQuestion":
        """Return the question with the readings corrected for effects.

        Columns of all other effects are kept. The sensors' noise in residual and columns is simulated by adding it
        once more, corrected likewise: a correction must neither remove noise nor make noise resemble an effect.
        applied: each effect with the number of its form
        """
        return self._keeping(replace(self, correction=tuple(applied)), *OF_READINGS)

    def uncorrected(self) -> "FieldQuestion":
        """Return the question without a correction."""
        return self._keeping(replace(self, correction=None), "_gram_as_read")

    @cached_property
    def _renewed(self) -> list[Proposal]:
        """Effects of the layout whose columns the correction changes; those of a clock are computed always."""
        own = [a.proposal for _, a in self.correction or ()]
        return [p for p in own if not p.clock and not self._is_refined(p)]

    def _is_refined(self, p: Proposal) -> bool:
        return self.refined_as_read is not None and p is self.refined_as_read.proposal

    @cached_property
    def _kept_columns(self) -> frozenset[int]:
        """Columns that a correction keeps: those of all effects but the corrected ones."""
        layout = self.machine.layout
        renewed = {k for p in self._renewed for k in layout.places[layout.proposals.index(p)]}
        return frozenset(range(layout.first, layout.clock)) - renewed

    @cached_property
    def _corrected(self) -> "_Corrected":
        """The recordings with their readings corrected."""
        if self.correction is None:
            return _Corrected(self.as_read, None, self.refined_as_read)
        machine, layout = self.machine, self.machine.layout
        effects = [a.imposed for _, a in sorted(self.correction, key=lambda each: each[1].proposal.clock)]
        own = [*self._renewed, *(a.proposal for _, a in self.correction if self._is_refined(a.proposal))]
        places = [k - layout.first for p in self._renewed for k in layout.places[layout.proposals.index(p)]]
        changed = [*range(layout.first), *(layout.first + k for k in places), *range(layout.clock, layout.width)]
        seen, again, before, after = [], list[Array](), list[SharedNoise](), list[SharedNoise]()
        for each in self.as_read:
            lost = np.isnan(each.rows.residual)
            other, recording = machine.regressors.corrected(each.recording, effects)
            rows = other.rows(recording, own, lost)
            again.append(rows.effects[..., len(places) :].astype(np.float64))
            rows = replace(rows, effects=rows.effects[..., : len(places)])
            other, twin = machine.regressors.corrected(replace(each.recording, values=each.twin), effects)
            noisy = other.rows(twin, own, lost)
            noisy = replace(noisy, effects=noisy.effects[..., : len(places)])
            # Columns that are kept have the noise of the recording as read. The residual and the other columns have
            # that of the corrected one, whose readings may be shifted in time.
            columns = layout.columns(rows, recording)
            change = layout.columns(noisy, twin) - columns[: len(noisy.t)]
            added = each.added.with_columns(changed, Blocks.whitened(change, machine.floor))
            blocks = each.blocks.with_columns(changed, Blocks.whitened(columns, machine.floor))
            effects_columns = each.rows.effects.copy()
            effects_columns[..., places] = rows.effects
            rows = replace(rows, effects=effects_columns)
            seen.append(replace(each, recording=recording, rows=rows, blocks=blocks, added=added))
            before.append(each.shared(()))
            after.append(seen[-1].shared(()))
        refined = self.refined_as_read
        if refined is not None and again[0].shape[-1]:
            refined = replace(refined, columns=tuple(again))
        return _Corrected(tuple(seen), _energy_of(before) - _energy_of(after), refined)


@dataclass(frozen=True)
class _Corrected:
    """Recordings with their readings corrected for effects.

    seen:    the recordings
    noise:   (R, 1 + POLYNOMIALS) energy of the sensor noise that the correction removed; None without a correction
    refined: an effect with refined shape parameters, its columns along the corrected recordings
    """

    seen: tuple[Seen, ...]
    noise: Array | None
    refined: Refined | None


def _energy_of(parts: Sequence[SharedNoise]) -> Array:
    """Return the energy (R, 1 + POLYNOMIALS) of the sensors' noise in the residual of recordings."""
    products, counts = np.concatenate([n.products for n in parts]), np.concatenate([n.counts for n in parts])
    return SharedNoise(products, counts).energy()


# Screening and beam


def searched(case: Likelihood, wanted: Sequence[int]) -> list[Hypothesis]:
    """Return hypotheses with more and more effects.

    If a healthy machine at another temperature is likelier than one under the usual conditions, both are searched on
    their own. In one search, the most probable hypotheses would all contain another temperature, and an effect that
    explains the recordings without it would not be tried.
    """
    usual, other = _without_effects(case)
    if other and other[0].log > max(h.log for h in usual):
        return [*_grown(case, usual, wanted, USUAL_CONDITIONS), *_grown(case, other, wanted, case.machine.temperatures)]
    return _grown(case, [*usual, *other], wanted, case.machine.conditions)


def _grown(
    case: Likelihood, beam: list[Hypothesis], wanted: Sequence[int], conditions: Sequence[Conditions]
) -> list[Hypothesis]:
    """Return hypotheses with more and more effects, while one more is worth its prior probability.

    beam:       hypotheses without effects
    conditions: that are tried
    """
    found: dict[tuple[int, ...], Hypothesis] = {(): max(beam, key=lambda h: h.log)}
    worth = -float(np.log(SECOND_EFFECT * (1.0 - HEALTHY - UNKNOWN_EFFECT) / max(len(wanted), 1)))
    for _ in range(DEEPEST):
        grown, parents = dict[tuple[int, ...], Hypothesis](), dict[tuple[int, ...], tuple[int, ...]]()
        for base in sorted(beam, key=lambda h: -h.log):
            for p in screened(case, base, wanted)[:REFINED]:
                forms = tuple(sorted((*base.forms, p)))
                if forms in found or parents.setdefault(forms, base.forms) != base.forms:
                    continue
                h = case.with_one_more(base, p)
                if forms not in grown or h.log > grown[forms].log:
                    grown[forms] = h
        first = sorted(grown.values(), key=lambda h: -h.log)[:WIDTH]
        again = (case.likeliest(h.forms, h.noise, h.doubt, conditions) for h in first)
        best = sorted(again, key=lambda h: -h.log)
        found |= grown | {h.forms: h for h in best}
        base_log = max(b.log for b in beam)
        gained = max((effective_share(h.rest) * (h.log - base_log) for h in best), default=-np.inf)
        if not best or (len(best[0].forms) > 1 and gained < worth):
            break
        beam = best
    return list(found.values())


def _without_effects(case: Likelihood) -> tuple[list[Hypothesis], list[Hypothesis]]:
    """Return two lists of hypotheses of a healthy machine: under the usual conditions, and at another temperature.

    The second list has only the likeliest temperature; it is empty if no other temperature is tried.
    """
    each = [case.hypothesis((), replace(case.machine.noise, conditions=c)) for c in case.machine.conditions]
    usual = [h for h in each if h.noise.conditions.temperature is None]
    other = [h for h in each if h.noise.conditions.temperature is not None]
    return usual, sorted(other, key=lambda h: -h.log)[:1]


def screened(case: Likelihood, base: Hypothesis, wanted: Sequence[int]) -> list[int]:
    """Return forms to be added to a hypothesis, the most promising first, each with its most probable noise."""
    state, named = case.state(base.noise), {case.forms[p].key for p in base.forms}
    free = [p for p in wanted if case.forms[p].key not in named and case.forms[p].columns]
    if not free:
        return []
    if case.nuisance is not None:
        return sorted(free, key=lambda p: -case.screening((*base.forms, p), state))
    residuals, shift = _with_each(case, base.forms, free, state)
    _, log = likeliest_noise(case.gram, *case.gram.certain_energies(residuals), case.machine.noise)
    log -= 0.5 * np.einsum("hi,hi->h", shift, shift @ case.machine.prior_precision(base.noise.conditions)[0])
    return [free[k] for k in np.argsort(-log).tolist()]


def _with_each(
    case: Likelihood, forms: tuple[int, ...], free: list[int], state: MarginalLikelihood
) -> tuple[Array, Array]:
    """Return the residual with each of some forms (H, K+1) added to a hypothesis, and the parameters (H, K).

    All forms with equally many sizes are solved at once.
    """
    follows, size = state.covariance @ state.known, len(state.score)
    whole = state.known - state.known @ follows
    residuals, shift = np.ones((len(free), size + 1)), np.empty((len(free), size))
    alike = dict[int, list[int]]()
    for k, p in enumerate(free):
        alike.setdefault(len(case.forms[p].columns), []).append(k)
    for at in alike.values():
        each = [(*forms, free[k]) for k in at]
        own = np.array([case.columns(f) for f in each])
        side = np.array([np.concatenate([case.forms[p].side_precision for p in f]) for f in each])
        precision = np.where(side > 0.0, side, FREE_PRECISION)
        known = symmetric_positive(whole[own[:, :, None], own[:, None, :]]) + precision[:, :, None] * np.eye(
            own.shape[1]
        )
        score = state.score[own] - precision * np.array([case.already(f) for f in each])
        more = np.linalg.solve(known, score[..., None])[..., 0]
        shift[at] = state.fitted - np.einsum("khm,hm->hk", follows[:, own], more)
        residuals[at, :-1] = -case.machine.mean - shift[at]
        np.subtract.at(residuals, (np.array(at)[:, None], own), more)
    return residuals, shift


# Incidents: contact, unmeasured slewing, a free torque, in single blocks


@dataclass(frozen=True)
class BlockIncident:
    """Incident of single blocks, alone or besides the effects of a hypothesis.

    key:      name and location; UNKNOWN of a free torque
    proposal: the effect
    sizes:    (B,) its typical size in each block, 0 where it is absent
    log:      log probability of the recordings with it, its blocks' prior included
    rest:     residual at the worst joint with it, in noise floors
    before:   residual at the worst joint if its torque is not removed, in noise floors; all else is as fitted with it
    nuisance: the nuisance of the blocks in which it is present
    """

    key: Key
    proposal: Proposal
    sizes: Array
    log: float
    rest: float
    before: float
    nuisance: Nuisance

    @property
    def share(self) -> float:
        """Share of the blocks in which it is present."""
        return float(np.mean(self.sizes > 0.0))

    @property
    def log_prior(self) -> float:
        """Log prior probability of its blocks."""
        return log_prior_of_blocks(self.sizes > 0.0)


def incidents(
    question: FieldQuestion,
    case: Likelihood,
    residual: Array,
    wanted: Callable[[Proposal], bool],
    beside: Hypothesis | None = None,
) -> list[BlockIncident]:
    """Return every incident with its most probable blocks, alone or besides a hypothesis.

    residual: coefficients (K'+1,) of the residual without it
    """
    layout, found = question.machine.layout, []
    for p, columns in zip(layout.proposals, layout.places, strict=True):
        if p.course is not TimeCourse.WINDOWS or not wanted(p):
            continue
        whole = question.nuisance(columns)
        forms = beside.forms if beside else ()
        doubt, noise = (beside.doubt, beside.noise) if beside else (None, case.machine.noise)
        sizes = whole.likeliest_sizes(residual, noise, INCIDENT_SIZES)
        for _ in range(SETTLING):
            held = replace(case, nuisance=whole.present(sizes))
            noise = held.hypothesis(forms, noise, doubt).noise
            now = whole.likeliest_sizes(held.under(forms, held.state(noise))[2], noise, INCIDENT_SIZES)
            if np.array_equal(now, sizes):
                break
            sizes = now
        if not np.any(sizes):
            continue  # the same as without the incident
        own = whole.present(sizes)
        held = replace(case, nuisance=own)
        h = held.likeliest(forms, noise, doubt)
        key = UNKNOWN if p.name == UNKNOWN_TORQUE else (p.name, p.at)
        before = float(np.max(case.rests(held.under(forms, held.state(h.noise))[2])))
        found.append(BlockIncident(key, p, sizes, h.log + log_prior_of_blocks(sizes > 0.0), h.rest, before, own))
    return found


def changed_load(question: FieldQuestion, case: Likelihood) -> LoadStep | None:
    """Return the most probable change of a known load; None if none is likelier than no change."""
    loaded = [(span, s) for span, s in zip(question.spans, question.seen, strict=True) if s.recording.load_kg]
    if not loaded:
        return None
    layout = question.machine.layout
    nuisance = question.nuisance([layout.size + INCIDENTAL.index(name) for name in STEP_COLUMNS])
    across, precision = nuisance.weighted(case.machine.noise)
    score, information = across @ question.plain, precision - np.eye(precision.shape[-1])
    begins, ends = dict[str, int](), dict[str, int]()
    for (first, last), seen in loaded:
        begins.setdefault(seen.recording.name, first)
        ends[seen.recording.name] = last
    best, found = 0.0, None
    for (first, last), seen in loaded:
        name = seen.recording.name
        for k in range(first, last - 1):
            gain = _step_gain(score, information, begins[name], k, ends[name])
            if gain > best:
                best, found = gain, LoadStep(k, ends[name])
    return found


def _step_gain(score: Array, information: Array, first: int, changed: int, end: int) -> float:
    """Return the evidence [nats] that a load changes in a block, the centre before and after it unknown.

    first, end: blocks in which the load is known
    changed:    block of the change
    """
    parts = [(slice(first, end), 1), (slice(changed, changed + 1), 0), (slice(changed + 1, end), 0)]
    pulled = np.concatenate([score[part][:, axis:].sum(axis=0) for part, axis in parts])

    def common(a: tuple[slice, int], b: tuple[slice, int]) -> Array:
        blocks = slice(max(a[0].start, b[0].start), min(a[0].stop, b[0].stop))
        return np.asarray(information[blocks][:, a[1] :, b[1] :].sum(axis=0))

    whole = np.block([[common(a, b) for b in parts] for a in parts]) + np.eye(len(pulled))
    before = len(STEP_COLUMNS) - 1
    return float(log_evidence(pulled, whole) - log_evidence(pulled[:before], whole[:before, :before]))


# Working recordings: unknown loads, and contact with unknown forces


@dataclass(frozen=True)
class Spill:
    """Spill of an unknown load while the tool had no contact.

    key:      name and location of the effect
    proposal: the effect
    sizes:    (W, M) change of the load at each of W times [kg, kg m, kg m]
    errors:   (W, M) standard errors
    course:   (W, B) blocks after each time, until the load is dumped
    log:      log probability of the recordings
    odds:     log of the odds that so many of the loads spill, compared with a healthy machine's
    rest:     residual at the worst joint, in noise floors
    before:   residual at the worst joint without a spill, in noise floors
    """

    key: Key
    proposal: Proposal
    sizes: Array
    errors: Array
    course: Array
    log: float
    odds: float
    rest: float
    before: float


@dataclass(frozen=True)
class Work:
    """Working recordings, of which only stretches without contact count, each with one payload.

    question: the recordings with these rows
    case:     their likelihood with the payloads
    gaps:     (R,) residual with the payloads before any effect, in noise floors
    share:    share of the rows with contact or an unknown load
    spill:    spill of a load; None if there was none
    names:    of the working recordings
    """

    question: FieldQuestion
    case: Likelihood
    gaps: Array
    share: float
    spill: Spill | None
    names: frozenset[str]


def at_work(question: FieldQuestion, names: frozenset[str]) -> Work | None:
    """Return the recordings with only the contact-free stretches of some; None where no stretch is free of contact.

    names: of the recordings that may be working recordings
    """
    machine, unit, size = question.machine, np.append(question.unit, 1.0), question.size
    settle, typical = machine.regressors.slow.settle_steps, machine.layout.typical[:4]
    laid = list[NDArray[np.int_] | None]()
    numbers, sizes = list[int](), list[float]()  # by block: of its load, and the load's typical size
    carried, parts = list[bool](), list[tuple[int, int]]()  # by load: carried on from the one before; its blocks
    apart, total = 0.0, 0
    for seen, blocks, (first_block, _) in zip(question.seen, question.blocks, question.spans, strict=True):
        rows = blocks.rows.reshape(-1, *blocks.rows.shape[2:])
        usable = blocks.usable.reshape(-1, blocks.usable.shape[2])
        if seen.recording.name not in names:
            laid.append(None)
            numbers += [len(carried)] * len(blocks.rows)
            sizes += [0.0] * len(blocks.rows)
            carried.append(False)
            parts.append((first_block, first_block + len(blocks.rows)))
            continue
        lasting_rows = np.concatenate([rows[..., :size], rows[..., -1:]], axis=-1).astype(np.float64)
        residual = lasting_rows @ (question.plain * unit)
        tilt = np.pad(np.sum(seen.rows.posture, axis=1), (0, len(rows) - len(seen.rows.t)), mode="edge")
        found = free_stretches(residual, rows[..., size : size + 4].astype(np.float64), usable, tilt, typical, settle)
        for stretch in found:
            numbers += [len(carried)] * len(stretch.blocks)
            sizes += [PAYLOAD if stretch.loaded else CARRY_BACK] * len(stretch.blocks)
            carried.append(stretch.carried_on and not seen.recording.load_kg)
            parts.append(
                (first_block + stretch.first // BLOCK_ROWS, first_block + (stretch.last - 1) // BLOCK_ROWS + 1)
            )
            length = stretch.last - stretch.first + 2 * settle
            total -= 0 if stretch.loaded and not seen.recording.load_kg else length
        total += len(seen.rows.t)
        laid.append(_rows_of(found))
        apart += log_of_other_rows(residual, usable, found)
    count = sum(len(s.rows.t) for s in question.seen if s.recording.name in names)
    if not numbers or not any(sizes):
        return None
    other = replace(question, laid=tuple(laid), apart=apart)
    case = other.likelihood()
    plain = Nuisance.of(other.blocks, range(size), question.unit, range(size, size + 4), typical)
    scaled = plain.sized(np.array(sizes))
    shared = np.concatenate(
        [
            _shared_by_block(s.shared(range(machine.layout.size, machine.layout.size + 4)), b, typical)
            for s, b in zip(question.seen, other.blocks, strict=True)
        ]
    )
    payload = Payload(
        scaled.across,
        scaled.within,
        scaled.waves,
        scaled.smooth,
        np.array(numbers),
        np.array(carried),
        shared * np.array(sizes)[:, None, None, None],
        case.gram.noise_energy,
    )
    free = replace(case, nuisance=payload.with_loads(np.zeros(len(carried), dtype=np.bool_)))
    losses = payload.losses(free.under((), free.state(machine.machine.noise))[2], machine.machine.noise)
    same = replace(free, nuisance=payload)
    gaps = same.rests(other.plain, machine.machine.noise)
    changed = replace(free, nuisance=payload.with_loads(payload.carried_on & ~losses.differs))
    spill = _spill(question, changed, payload, losses, parts, gaps)
    return Work(other, changed, gaps, total / max(count, 1), spill, names)


def _rows_of(stretches: Sequence[FreeStretch]) -> NDArray[np.int_]:
    """Return the rows of stretches in whole blocks, one after the other; -1 for an empty row."""
    return np.concatenate([np.zeros(0, dtype=np.int_), *(stretch.blocks.ravel() for stretch in stretches)])


def _shared_by_block(noise: SharedNoise, blocks: Blocks, typical: Array) -> Array:
    """Return the shared noise (B, R, 1 + POLYNOMIALS, 4) of a load's columns in each block, from its mean per row."""
    joints = blocks.usable.shape[2]
    if not len(noise.products):
        return np.zeros((len(blocks.rows), joints, 1 + POLYNOMIALS, 4))
    products = noise.products[..., :4].sum(axis=0) * typical
    rows, count = np.maximum(noise.counts.sum(axis=0), 1.0), np.maximum((noise.counts > 0.0).sum(axis=0), 1.0)
    found = np.tile(products / count[:, None, None], (len(blocks.rows), 1, 1, 1))
    found[:, :, 0] = products[:, 0] / rows[:, None] * blocks.counts[..., None]
    return np.asarray(found)


def _spill(
    question: FieldQuestion,
    case: Likelihood,
    payload: Payload,
    losses: Losses,
    parts: list[tuple[int, int]],
    gaps: Array,
) -> Spill | None:
    """Return the spill of loads that are carried on; None without one.

    A healthy machine's load seldom spills: every load is evidence of INCIDENT against SPILL.
    """
    proposal = next((p for p in question.machine.layout.proposals if p.name == PayloadSpill().about.name), None)
    if proposal is None or not np.any(losses.fell):
        return None
    idle = case.likeliest((), case.machine.noise)
    unit = PAYLOAD * question.machine.layout.typical[:3]
    sizes, errors = (each[losses.fell][:, :3] * unit for each in (-losses.less, losses.errors))
    about = proposal.about
    errors = np.hypot(errors, about.form * np.abs(sizes))
    form = Form(proposal.name, proposal.at, (0,), about.low, about.high, about.sign)
    size = about.sign * float(np.sqrt(np.mean(sizes[:, 0] ** 2)))
    density = form.log_prior(np.array([size]), np.array([[np.mean(errors[:, 0] ** 2) / len(sizes)]]))
    carried = losses.fell[payload.carried_on]
    often, seldom = (float(np.sum(np.log(np.where(carried, p, 1.0 - p)))) for p in (INCIDENT, SPILL))
    log, odds = idle.log + density + float(np.log(np.sqrt(2.0 * np.pi) * unit[0])), often - seldom
    load, number = np.cumsum(~payload.carried_on), np.arange(len(payload.carried_on))
    course = np.zeros((int(np.sum(losses.fell)), len(question.times)))
    for row, n in enumerate(np.flatnonzero(losses.fell)):
        for k in number[(load == load[n]) & (number >= n)]:
            course[row, slice(*parts[k])] = 1.0
    key, before = (proposal.name, proposal.at), float(np.max(gaps))
    return Spill(key, proposal, sizes, errors, course, log, odds, idle.rest, before)


# The whole search


@dataclass(frozen=True, eq=False)
class Candidate:
    """Examined hypothesis.

    hypothesis: lasting effects, with magnitudes
    question:   the recordings, corrected for its effects
    incident:   incident of single blocks besides them; None if there is none
    before:     residual at the worst joint of all rows, in noise floors, where the rows with contact were left out of
                the fit; infinite of other hypotheses than contact alone
    """

    hypothesis: Hypothesis
    question: FieldQuestion
    incident: BlockIncident | None = None
    before: float = np.inf

    @property
    def log(self) -> float:
        """Log probability of the recordings, without the prior of its effects."""
        return self.hypothesis.log

    @property
    def beside_contact(self) -> bool:
        """True where some rows have an incident or contact besides its effects."""
        return self.incident is not None or self.question.laid is not None

    def counted(self) -> list[Mask]:
        """Return the rows (T,) of each recording that count: those without incident or contact."""
        found, question = [], self.question
        for n, (seen, span) in enumerate(zip(question.seen, question.spans, strict=True)):
            count = len(seen.rows.t)
            rows = np.ones(count, dtype=np.bool_)
            if self.incident is not None:
                rows = np.repeat(self.incident.sizes[slice(*span)] == 0.0, BLOCK_ROWS)[:count]
            elif question.laid is not None and question.laid[n] is not None:
                own = np.asarray(question.laid[n])
                rows = np.isin(np.arange(count), own[own >= 0])
            found.append(rows)
        return found

    @property
    def is_linear(self) -> bool:
        """True where the readings are not corrected for all of its errors of sensors and geometry."""
        bending = {p for p in self.hypothesis.forms if self.question.proposals[p].bends}
        return self.incident is None and not bending <= set(self.question.applied)

    @property
    def changes_parameters(self) -> bool:
        """Whether one of its effects changes what the model's parameters describe: masses or friction."""
        return any(self.question.proposals[p].of_parameters for p in self.hypothesis.forms)

    @property
    def keys(self) -> frozenset[Key]:
        """Names and locations of its effects; all free torques are one."""
        return frozenset(self.key(p) for p in self.hypothesis.forms)

    def key(self, form: int) -> Key:
        """Return name and location of a form."""
        key = self.question.forms[form].key
        return UNKNOWN if key[0] == UNKNOWN_TORQUE else key

    @property
    def rest(self) -> float:
        """Residual at the worst joint, in noise floors."""
        return self.hypothesis.rest


@dataclass(frozen=True)
class Found:
    """Result of a search.

    question:   the recordings, not corrected
    case:       their likelihood
    candidates: hypotheses of lasting effects, with or without an incident; the healthy machine among them
    incidents:  incidents of single blocks, without lasting effects
    gaps:       (R,) residual of each joint before any effect, in noise floors
    work:       working recordings; None if there are none
    """

    question: FieldQuestion
    case: Likelihood
    candidates: tuple[Candidate, ...]
    incidents: tuple[BlockIncident | Spill, ...]
    gaps: Array
    work: Work | None = None

    @property
    def healthy(self) -> Candidate:
        """Most probable hypothesis of a healthy machine."""
        plain = (c for c in self.candidates if not c.hypothesis.forms)
        return max((c for c in plain if self.work is not None or not c.beside_contact), key=lambda c: c.log)


def without_gap(residual: Array, floor: Array | float = 1.0) -> Mask:
    """Return the joints (R,) without a gap: the residual is as small as between two recordings of a healthy machine."""
    return np.asarray(residual**2 <= (1.0 + SAME_MACHINE) * floor**2)


def _named(model: Model, law: str) -> Iterator[tuple[int, Parameter]]:
    """Yield the parameters of a law of friction, with their numbers."""
    for k, parameter in enumerate(model.parameters):
        if parameter.name.rpartition(".")[2] == law:
            yield k, parameter


def examined(
    question: FieldQuestion,
    wanted: Callable[[Proposal], bool],
    watch: Callable[[str], None] = lambda _: None,
) -> Found:
    """Search for effects that may explain the recordings.

    wanted: whether an effect may be a cause
    """
    watch("hypotheses")
    case = question.likelihood()
    gaps = case.rests(question.plain)
    # Oil changes the friction of every cylinder; the zero of each sensor changes by itself.
    if np.count_nonzero(~without_gap(gaps)) < min(2, len(gaps)):
        question = question.with_same_oil()
        case = question.likelihood()
    step = changed_load(question, case)
    if step:
        question = replace(question, step=step)
        case = question.likelihood()
    allowed = [k for k, p in enumerate(question.proposals) if wanted(p)]
    if question.machine.source is not KnowledgeSource.DATA_SHEET:
        allowed = _showing(question, case, allowed, without_gap(gaps))
    hypotheses = searched(case, allowed)
    jumps = [p for p in allowed if question.forms[p].name == GLITCH]
    known = {h.forms for h in hypotheses}
    hypotheses += [case.likeliest((p,), case.machine.noise) for p in jumps if (p,) not in known]
    best = max(hypotheses, key=lambda h: h.log)
    alone = incidents(question, case, question.plain, wanted)
    candidates = [Candidate(h, question) for h in hypotheses]
    first = max([*alone, *_likeliest_beside(question, case, best, wanted)], key=lambda i: i.log, default=None)
    if first and first.log > best.log and (first.share <= FEW_BLOCKS or first.key[0] != CONTACT):
        held = replace(case, nuisance=first.nuisance, apart=first.log_prior)
        beside = searched(held, allowed)
        candidates += [Candidate(h, question, first) for h in beside if h.forms]
        alone = _with_likelier(alone, _without_effect(first, case, held, beside))
    if not without_gap(np.array([min(c.rest for c in candidates)]))[0]:
        single = [h for h in hypotheses if len(h.forms) == 1]
        for base in sorted(single, key=lambda h: -h.log)[:1]:
            candidates += _beside_contact(question, case, base, allowed)
        if (outside := _without_contact(question, question.plain)) is not None:
            candidates.append(_contact_alone(outside[1].likeliest((), case.machine.noise), *outside, case))
    work = _work(question, candidates, alone)
    if work is not None:
        return _examined_at_work(question, work, wanted)
    watch("effects at their magnitudes")
    candidates = _at_magnitudes(question, candidates, allowed)
    return Found(question, case, tuple(candidates), tuple(alone), gaps)


def _likeliest_beside(
    question: FieldQuestion, case: Likelihood, base: Hypothesis, wanted: Callable[[Proposal], bool]
) -> list[BlockIncident]:
    """Return the most probable incident besides the effects of a hypothesis; none if it has no effect."""
    if not base.forms:
        return []
    residual = case.under(base.forms, case.state(base.noise))[2]
    return sorted(incidents(question, case, residual, wanted, base), key=lambda i: -i.log)[:1]


def _beside_contact(
    question: FieldQuestion, case: Likelihood, base: Hypothesis, allowed: Sequence[int]
) -> list[Candidate]:
    """Return hypotheses without the rows with contact, located by a hypothesis of one effect.

    Some have no effect: contact alone, with which the others compete.
    """
    outside = _without_contact(question, case.under(base.forms, case.state(base.noise))[2])
    if outside is None:
        return []
    found = searched(outside[1], allowed)
    effects = [Candidate(h, outside[0]) for h in found if h.forms]
    return effects + [_contact_alone(h, *outside, case) for h in found if not h.forms]


def _contact_alone(h: Hypothesis, question: FieldQuestion, outside: Likelihood, case: Likelihood) -> Candidate:
    """Return the hypothesis of contact alone: no effect, and the rows with contact left out of the fit.

    question: recordings without these rows
    outside:  their likelihood
    case:     likelihood of all rows
    """
    coefficients = outside.under((), outside.state(h.noise))[2]
    return Candidate(h, question, before=float(np.max(case.rests(coefficients))))


def _without_effect(
    incident: BlockIncident, case: Likelihood, held: Likelihood, beside: Sequence[Hypothesis]
) -> BlockIncident:
    """Return the hypothesis of an incident alone, in the blocks in which it was found beside an effect.

    case:   likelihood without it
    held:   likelihood with it
    beside: hypotheses with it; one has no effect
    """
    h = max((h for h in beside if not h.forms), key=lambda h: h.log)
    before = float(np.max(case.rests(held.under((), held.state(h.noise))[2])))
    return replace(incident, log=h.log, rest=h.rest, before=before)


def _with_likelier(alone: list[BlockIncident], other: BlockIncident) -> list[BlockIncident]:
    """Return incidents with another one in place of that of the same proposal, if it is likelier or there is none."""
    same = [i for i in alone if i.proposal is other.proposal]
    if any(i.log >= other.log for i in same):
        return alone
    return [*(i for i in alone if i.proposal is not other.proposal), other]


def _without_contact(question: FieldQuestion, coefficients: Array) -> tuple[FieldQuestion, Likelihood] | None:
    """Return the recordings without the rows with contact, and their likelihood; the other rows count apart.

    Contact that begins within a block is no smooth force. None where no row, or most rows, have contact.
    coefficients: (K'+1,) of the residual in which contact is searched
    """
    machine, size, unit = question.machine, question.size, np.append(question.unit, 1.0)
    settle, typical = machine.regressors.slow.settle_steps, machine.layout.typical[:4]
    laid, apart, kept, whole = list[NDArray[np.int_] | None](), 0.0, 0, 0
    for seen, blocks in zip(question.seen, question.blocks, strict=True):
        rows = blocks.rows.reshape(-1, *blocks.rows.shape[2:])
        usable = blocks.usable.reshape(-1, blocks.usable.shape[2])
        lasting_rows = np.concatenate([rows[..., :size], rows[..., -1:]], axis=-1).astype(np.float64)
        residual, loads = lasting_rows @ (coefficients * unit), rows[..., size : size + 4].astype(np.float64)
        found = free_stretches(residual, loads, usable, np.zeros(len(rows)), typical, settle, payloads=False)
        kept += sum(stretch.last - stretch.first + 2 * settle for stretch in found)
        whole += len(seen.rows.t)
        laid.append(_rows_of(found))
        apart += log_of_other_rows(residual, usable, found)
    if not 0.0 < 1.0 - kept / max(whole, 1) <= FEW_BLOCKS:
        return None
    other = replace(question, laid=tuple(laid), apart=apart)
    return other, other.likelihood()


def _work(question: FieldQuestion, candidates: Sequence[Candidate], alone: Sequence[BlockIncident]) -> Work | None:
    """Return the working recordings; None if there are none.

    A recording is a working one if that is more probable than every hypothesis found for it. Each is judged separately:
    a check-up counts in full besides a working recording.
    """
    if without_gap(np.array([min(c.rest for c in candidates)]))[0]:
        return None  # neither contact nor an unknown load remains to be explained
    files = list(dict.fromkeys(s.recording.name for s in question.seen))
    chosen = set[str]()
    for name in files:
        if len(files) == 1:
            part, logs = question, [c.log for c in candidates] + [i.log for i in alone]
        else:
            part = replace(question, as_read=tuple(s for s in question.as_read if s.recording.name == name), step=None)
            case = part.likelihood()
            logs = [h.log for h in searched(case, [k for k, f in enumerate(part.forms) if f.columns])]
            logs += [i.log for i in incidents(part, case, part.plain, lambda _: True)]
        work = at_work(part, frozenset({name}))
        if work is None or work.share <= FEW_BLOCKS:
            continue
        idle = work.case.likeliest((), work.case.machine.noise)
        if idle.log <= max(logs):
            continue
        outside = _without_contact(part, part.plain)
        if outside is None or outside[1].likeliest((), outside[1].machine.noise).log < idle.log:
            chosen.add(name)  # contact in few rows and no load explain less
    return at_work(question, frozenset(chosen)) if chosen else None


def _examined_at_work(question: FieldQuestion, work: Work, wanted: Callable[[Proposal], bool]) -> Found:
    """Return hypotheses of all effects at joints with a gap, besides unknown loads.

    Masses on the tool are such loads themselves.
    """
    other, last = work.question, len(question.machine.regressors.model.machine.links) - 1
    allowed = [k for k, p in enumerate(other.proposals) if wanted(p) and other.forms[k].columns]
    allowed = _showing(other, work.case, allowed, without_gap(work.gaps))
    if work.names == {s.recording.name for s in question.seen}:
        allowed = [k for k in allowed if not (other.proposals[k].weighs and other.proposals[k].where == last)]
    hypotheses = searched(work.case, allowed)
    known, idle = {h.forms for h in hypotheses}, max((h for h in hypotheses if not h.forms), key=lambda h: h.log)
    # Effects that unknown loads hide keep their prior: without them, no gap would be too probable.
    hypotheses += [work.case.nearby(idle, p) for p in allowed if (p,) not in known]
    found = [Candidate(h, other) for h in hypotheses]
    spills = (work.spill,) if work.spill and wanted(work.spill.proposal) else ()
    return Found(other, work.case, tuple(found), spills, work.gaps, work)


def _showing(question: FieldQuestion, case: Likelihood, allowed: list[int], still: Mask) -> list[int]:
    """Return the forms whose largest torque is at a joint with a gap.

    Effects that begin later are exempt, and jumps of a reading, which the low-pass filters away.
    """
    found = []
    for k in allowed:
        form, p = question.forms[k], question.proposals[k]
        columns = list(form.columns)
        if p.course is TimeCourse.AFTER or form.name == GLITCH or not columns:
            found.append(k)
            continue
        energy = case.gram.whole[:, columns, columns] / np.maximum(case.gram.rows, 1.0)[:, None]
        if not np.all(still[np.argmax(energy, axis=0)]):
            found.append(k)
    return found


def _at_magnitudes(question: FieldQuestion, candidates: list[Candidate], allowed: Sequence[int]) -> list[Candidate]:
    """Return the candidates, the most probable ones renewed at their magnitudes.

    Their shape parameters are refined, their columns are computed at their magnitudes, and AGAIN second effects
    are tried besides the first of them.
    """

    def order(c: Candidate) -> float:
        return -c.log

    # Contact alone has no magnitude to be renewed at.
    renewable = [c for c in candidates if c.incident is None and (c.hypothesis.forms or not c.beside_contact)]
    plain = sorted(renewable, key=order)
    single = [c for c in plain if len(c.hypothesis.forms) == 1]
    sharper = {c: refined(c) for c in single[:SHAPED]}
    better = [other for c, other in sharper.items() if other.log > c.log]
    chosen = list(dict.fromkeys([*better, *plain[:AGAIN], *single[:AGAIN]]))
    found = [*candidates, *better]
    for c in chosen:
        if c.hypothesis.forms and any(c.question.proposals[p].bends for p in c.hypothesis.forms):
            if c in found:
                found.remove(c)  # its linear evidence is wrong at its magnitude
            found.append(corrected(c))
    best = max(found, key=lambda c: c.log)
    if best.question is not question and len(best.hypothesis.forms) == 1:
        case = best.question.without_rows().likelihood()
        known = {c.hypothesis.forms for c in found if c.question is best.question}
        for p in screened(case, best.hypothesis, allowed)[:AGAIN]:
            more = case.with_one_more(best.hypothesis, p)
            if more.forms not in known:
                found.append(Candidate(more, best.question))
    for _ in range(AGAIN):
        best = max(found, key=lambda c: c.log)
        if not best.is_linear:
            break
        found.remove(best)
        found.append(corrected(replace(best, question=best.question.uncorrected())))
    return _without_repetition(found)


def _without_repetition(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Return the likeliest of the candidates with the same effects, incident or contact, and temperature.

    The same hypothesis may be corrected at the magnitudes of several others; it counts once.
    """
    best: dict[object, Candidate] = {}
    for c in sorted(candidates, key=lambda c: c.log):
        effects = frozenset(c.question.proposals[p] for p in c.hypothesis.forms)
        beside = c.incident.key if c.incident else c.beside_contact
        best[effects, beside, c.hypothesis.noise.conditions.temperature] = c
    return list(best.values())


def refined(candidate: Candidate) -> Candidate:
    """Return a candidate of one effect with its shape parameters refined: time constants, widths, powers, pivots.

    Each parameter is searched from a coarse grid, at half the distance in each round; the others are kept.
    """
    question, (form,) = candidate.question, candidate.hypothesis.forms
    proposal, best = question.proposals[form], candidate
    if proposal.course or not shapes(proposal.group):
        return candidate
    regressors = question.machine.regressors
    sources = [regressors.column_source(s.recording, s.rows) for s in question.seen]
    twins = [regressors.column_source(replace(s.recording, values=s.twin), s.rows) for s in question.seen]
    group = proposal.group
    for shape in shapes(group):
        tries = {shape.position(float(getattr(group[0], shape.field))): (best, group)}

        def near(u: float, tries: dict[float, tuple[Candidate, Group]] = tries) -> bool:
            return any(abs(v - u) < NEAR_SHAPE for v in tries)

        for step in (None, *(STEP_OF_SHAPE * 0.5**k for k in range(FINER))):
            first = max(tries, key=lambda v: tries[v][0].log)
            for u in COARSE if step is None else (first - step, first + step):
                if 0.0 <= u <= 1.0 and not near(u):
                    own = shaped(group, {shape.field: shape.value(u)})
                    other = proposal._replace(group=own)
                    asked = question.with_refined(_refined_by(question, other, sources, twins))
                    h = asked.likelihood().hypothesis(
                        (len(asked.forms) - 1,), candidate.hypothesis.noise, candidate.hypothesis.doubt
                    )
                    tries[u] = Candidate(h, asked), own
        best, group = max(tries.values(), key=lambda t: t[0].log)
    return best


def _refined_by(
    question: FieldQuestion, proposal: Proposal, sources: Sequence[ColumnSource], twins: Sequence[ColumnSource]
) -> Refined:
    """Return an effect with its columns along the recordings, and their change from added sensor noise."""
    columns = tuple(source.columns(proposal) for source in sources)
    noisy = [twin.columns(proposal) for twin in twins]
    plain = [
        np.where(np.isnan(s.rows.residual[: len(n)])[..., None], np.nan, c[: len(n)])
        for s, n, c in zip(question.seen, noisy, columns, strict=True)
    ]
    return Refined(proposal, columns, tuple(n - c for n, c in zip(noisy, plain, strict=True)))


def corrected(candidate: Candidate) -> Candidate:
    """Return a candidate with the readings corrected for its effects, repeated until their magnitudes converge.

    Errors of sensors and of geometry are not linear in their magnitude.
    """
    question, start, found = candidate.question, candidate.hypothesis, candidate
    rows = sum(float(s.blocks.usable.sum()) for s in question.seen)
    for _ in range(CORRECTIONS):
        now, other = found.hypothesis, _corrected_once(found, question, start.doubt, KEPT_ROWS * rows)
        if other is None:
            break
        if found is not candidate and not _are_plausible(question, _applied(question, other.hypothesis)):
            break  # it diverges: the round before holds
        found, sizes = other, other.hypothesis.sizes
        if np.linalg.norm(sizes - now.sizes) < STILL * np.linalg.norm(sizes):
            break
    return found


def _corrected_once(
    candidate: Candidate, question: FieldQuestion, doubt: float, fewest_rows: float
) -> Candidate | None:
    """Return a candidate with the readings corrected for its effects; None where its magnitudes are impossible.

    question: the recordings, not corrected
    """
    now = candidate.hypothesis
    applied = _applied(question, now)
    if not _are_plausible(question, applied):
        return None
    other = question.corrected(applied)
    case = other.likelihood()
    if float(np.sum(case.gram.rows)) < fewest_rows:
        return None  # at these magnitudes the machine could not have moved so
    return Candidate(case.hypothesis(now.forms, now.noise, doubt), other.without_rows())


def _are_plausible(question: FieldQuestion, applied: Sequence[tuple[int, Applied]]) -> bool:
    """Return whether no magnitude exceeds the largest plausible one."""
    forms = question.forms
    return all(np.linalg.norm(a.sizes[: forms[p].components]) <= BEYOND * forms[p].high for p, a in applied)


def _applied(question: FieldQuestion, h: Hypothesis) -> list[tuple[int, Applied]]:
    """Return the effects of a hypothesis that are errors of readings or geometry, each with the number of its form.

    Their sizes are in SI units.
    """
    found, k = [], 0
    for p in h.forms:
        form = question.forms[p]
        sizes = h.sizes[k : k + len(form.columns)] * question.unit_of(p)
        k += len(form.columns)
        if question.proposals[p].bends:
            found.append((p, Applied(question.proposals[p], sizes)))
    return found
