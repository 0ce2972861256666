"""References of a diagnosis: which of them are alike, and sentences about the others."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cylforce.diagnosis.constants import FEW_BLOCKS
from cylforce.diagnosis.model import CENTRE, ColumnLayout, quiet_blocks
from cylforce.diagnosis.regressors import Regressors, TorqueRows
from cylforce.diagnosis.statistics import Mask, in_blocks
from cylforce.estimation.model import Model
from cylforce.programs.common.recorded import SHORTEST_S
from cylforce.readings.constants import BLOCK_ROWS, CLEAR_GAP
from cylforce.readings.faulty_sensors import faulty_sensors
from cylforce.readings.outliers import References
from cylforce.readings.recording import Recording, names_of

NONE_SHORT: Mapping[str, str] = {}


@dataclass(frozen=True)
class Alike:
    """References that are alike.

    kept:     recordings that count
    warnings: sentences about the others
    """

    kept: list[Recording]
    warnings: list[str]


def alike(
    model: Model,
    recordings: Sequence[Recording],
    short: Mapping[str, str] = NONE_SHORT,
    field: Sequence[Recording] = (),
) -> Alike:
    """Return the references whose sensors are sound and that are alike.

    short: names of recordings without a stretch that is long enough, with the reason
    field: recordings of the machine under diagnosis, which show how its sensors read
    """
    faulty = faulty_sensors(model, recordings, field)
    kept = [each for each in recordings if each.name not in {sensor.name for sensor in faulty}]
    seen = _Seen.of(model, kept)
    unlike = seen.references.outliers()
    warnings = [
        f"{name} has no gapless stretch of {SHORTEST_S:.0f} s{f' ({why})' if why else ''}: left out of the references"
        for name, why in short.items()
    ]
    warnings += [f"{sensor.sentence}; it is left out of the references" for sensor in faulty]
    warnings += [f"{name} is unlike the other references: left out; what changed between them?" for name in unlike]
    kept = [each for each in kept if each.name not in unlike]
    working = seen.at_work(names_of(kept))
    warnings += [
        f"{name} shows contact or unknown loads in {100.0 * seen.work_share[name]:.0f} % of its motion: left out "
        "beside the other references, which show the machine without them"
        for name in working
    ]
    kept = [each for each in kept if each.name not in working]
    warnings += seen.mostly_work(names_of(kept)) or seen.contradicting(names_of(kept))
    return Alike(kept, warnings)


def references_of(
    model: Model, recordings: Sequence[Recording], rows: Sequence[TorqueRows], counted: Sequence[Mask]
) -> References:
    """Return recordings as references to compare.

    rows:    of each recording, with parameters that are zero
    counted: (B,) which blocks of each count
    """
    layout, columns = ColumnLayout(model, ()), []
    count, centre = len(model.parameters), slice(layout.size + 1, layout.size + 1 + CENTRE)
    for recording, own, blocks in zip(recordings, rows, counted, strict=True):
        whole = layout.columns(own, recording)
        load = whole[..., centre] * float(recording.load_kg > 0.0)
        torque = np.where(_of_rows(blocks, own)[:, None, None], whole[..., -1:], np.nan)
        columns.append((recording.name, np.concatenate([whole[..., :count], load, torque], axis=-1)))
    return References.of(model.prior, columns)


def _of_rows(blocks: Mask, rows: TorqueRows) -> Mask:
    return np.repeat(blocks, BLOCK_ROWS)[: len(rows.t)]


@dataclass(frozen=True)
class _Seen:
    """References beside each other.

    references: in the blocks without contact and unknown loads
    total_s:    seconds of each recording, by name
    counted_s:  seconds of these blocks, by name
    work_share: share of the blocks with motion that have contact or unknown loads, by name
    joints:     (R,) of each recording, by name: joints that move without contact and unknown loads
    """

    references: References
    total_s: Mapping[str, float]
    counted_s: Mapping[str, float]
    work_share: Mapping[str, float]
    joints: Mapping[str, Mask]

    @classmethod
    def of(cls, model: Model, recordings: Sequence[Recording]) -> "_Seen":
        """Return recordings beside each other."""
        regressors = Regressors(model, np.zeros(len(model.parameters)))
        rows = [regressors.rows(each, ()) for each in recordings]
        counted = quiet_blocks(ColumnLayout(model, ()), rows, recordings) if rows else []
        total, quiet = dict[str, float](), dict[str, float]()
        moving, idle, joints = dict[str, int](), dict[str, int](), dict[str, Mask]()
        for each, own, blocks in zip(recordings, rows, counted, strict=True):
            name, on = each.name, _of_rows(blocks, own)
            moves = np.any(in_blocks(np.isfinite(own.residual)), axis=1)  # (B, R) blocks in which a joint moves
            total[name] = total.get(name, 0.0) + len(on) / regressors.rows_hz
            quiet[name] = quiet.get(name, 0.0) + float(np.sum(on)) / regressors.rows_hz
            moving[name] = moving.get(name, 0) + int(np.sum(np.any(moves, axis=1)))
            idle[name] = idle.get(name, 0) + int(np.sum(np.any(moves, axis=1) & blocks))
            shown = np.any(moves[blocks], axis=0)
            joints[name] = joints.get(name, np.zeros_like(shown)) | shown
        share = {name: 1.0 - idle[name] / max(moving[name], 1) for name in moving}
        return cls(references_of(model, recordings, rows, counted), total, quiet, share, joints)

    def at_work(self, names: Sequence[str]) -> list[str]:
        """Return the working recordings that can be left out: the others show their joints without contact and loads.

        Blocks of work in which contact is too weak to be significant bias the healthy machine.
        """
        working = [name for name in names if self.work_share[name] > FEW_BLOCKS]
        others = [self.joints[name] for name in names if name not in working]
        shown = np.any(others, axis=0) if others else False
        return [name for name in working if np.all(shown | ~self.joints[name])]

    def mostly_work(self, names: Sequence[str]) -> list[str]:
        """Return sentences about references that seem to be nearly all work in comparison with the others."""
        said = []
        for name in names if len(names) > 1 else ():
            total, counted = self.total_s[name], self.counted_s[name]
            if counted < SHORTEST_S < total:
                said.append(
                    f"of {name} only {counted:.0f} of {total:.0f} s tell of the machine: beside the other references, "
                    "the rest looks like contact or unknown loads; if there were none, these references contradict "
                    "each other"
                )
        return said

    def contradicting(self, names: Sequence[str]) -> list[str]:
        """Return a sentence on two references whose residual is far larger fitted together than separately."""
        references = References(self.references.prior, {name: self.references.grams[name] for name in names})
        times = references.contradiction()
        if times < CLEAR_GAP:
            return []
        both = " and ".join(names)
        said = (
            f"{both} contradict each other: at a joint they leave {times:.0f} times as much together as by themselves"
        )
        cure = "one of them is not in order, or its load is not as said: leave it out, or add another reference"
        return [f"{said}; {cure}"]
