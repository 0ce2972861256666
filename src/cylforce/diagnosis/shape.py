"""The shape of what no effect explains: at which joint it is, and of which one quantity it is mostly a function."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from cylforce.diagnosis import momentary
from cylforce.diagnosis.functions import FOLDS, SPAN_S, Family, families, foreseen
from cylforce.diagnosis.residuals import held_out, held_out_clean
from cylforce.diagnosis.track import Track, track
from cylforce.diagnosis.verdict import Judged, Search, Verdict
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

WORTH = 0.15  # of the excess energy that a function has to foresee to be told
SIMPLER = 0.05  # of it, by which a function of more freedom must be better
NEARLY = 0.2  # of what the best leaves, the same
REAL = 1.0  # of the floor's energy: a lesser excess has no shape
MOST = 0.6  # of the excess that is in few moments
MENTIONED = 3  # alternatives
CONFIRM = {
    "constant": "move the {at} slowly, a little, at three angles: is it the same everywhere?",
    "speed": "move the {at} alone at five speeds, both ways: does it follow the same curve?",
    "position": "move the {at} alone, slowly, thrice through its range and back: does it return at the same angles?",
    "periodic": "move the {at} alone, slowly, through its range: do the waves return at the same angles?",
    "load": "repeat the same moves of the {at} empty and with two known loads: does it grow with the load?",
    "turning": "turn the base with the arm held still: does it show at the {at}?",
    "time": "repeat the same moves of the {at} every ten minutes: does it go on changing?",
    "reversal": "reverse the {at} slowly, with waits of 1 to 10 s in between: does it fade in the same time?",
    "swinging": "move the {at} alone, then another joint, then with the engine at another speed: does it swing on?",
    "moments": "repeat the moves at which it shows, see the plot of the {at}: does it return?",
}


class Shape(NamedTuple):
    """`of` what the residual is a function, the `share` of the excess energy that is foreseen so, unseen; `number`:
    periods a turn, or hertz, `whose`: which cylinder's force, NaN and -1 where there is none."""

    of: str
    share: float
    number: float = float("nan")
    whose: int = -1

    def detail(self, machine: Machine) -> str:
        """What the word alone does not say."""
        if self.whose >= 0:
            return f"force of the {machine.cylinders[self.whose].name} cylinder"
        return {"periodic": f"{self.number:.0f} a turn", "swinging": f"{self.number:.2g} Hz"}.get(self.of, "")


class Lie(NamedTuple):
    """The row `at` of the joint, its rows, and their shapes: the one that is told, then all others, best first."""

    at: int
    track: Track
    shapes: tuple[Shape, ...]


def told(lie: Lie | None, machine: Machine) -> dict[str, Any] | None:
    """The same as plain values."""
    if lie is None:
        return None
    at, others = machine.links[machine.rows[lie.at]].name, [s for s in lie.shapes[1:] if s.share > 0.0]
    first, *rest = [
        {"of": s.of, "detail": s.detail(machine), "share": s.share} for s in (lie.shapes[0], *others[:MENTIONED])
    ]
    return {"at": at, **first, "alternatives": rest}


def confirm(shape: dict[str, Any] | None) -> list[str]:
    """The experiment that would tell whether a shape (as plain values) is real."""
    return [CONFIRM[shape["of"]].format(at=shape["at"])] if shape and shape["of"] in CONFIRM else []


def unexplained(search: Search, judged: Judged) -> Lie | None:
    """What the named causes leave, if it is more than what is always left, and if they were expected to do better."""
    if judged.verdict not in (Verdict.UNKNOWN, Verdict.PARTLY):
        return None
    problem = search.original
    rows = range(len(problem.model.machine.rows))
    left, unseen = _left(search, judged), held_out_clean(search)
    faulty = [track(problem.model, problem.faulty, left, r) for r in rows]
    return lie(faulty, [track(problem.model, problem.clean, unseen, r) for r in rows], search.floor.rms)


def _left(search: Search, judged: Judged) -> list[Array]:
    """Residuals (T, R) [N m] of the faulty recordings, the named causes taken out."""
    if not judged.named:
        return held_out(search.original, search.original.blocks(search.floor), ())
    named = {n.cause.key for n in judged.named}
    pairs = zip(search.causes, search.evidence.held, strict=True)
    return held_out(search.problem, search.blocks, [term for cause, term in pairs if cause.key in named])


def lie(faulty: Sequence[Track], clean: Sequence[Track], floor: Array) -> Lie | None:
    """Of all joints that of which most is foreseen, in units of what is always left there: `floor` (R,) [N m, rms], or
    what the clean recordings' rows have, unseen by their fit."""
    found = []
    for r, (here, usual) in enumerate(zip(faulty, clean, strict=True)):
        least = float(np.sqrt(np.mean(usual.left**2))) if usual.left.size else float(floor[r])
        if not here.left.size:
            continue
        excess = float(np.mean(here.left**2)) / least**2 - 1.0
        each = shapes(here, usual, least)
        told = max(each[0].share, WORTH)  # that it is the worst joint counts where nothing is foreseen
        found.append((excess * told, Lie(r, here, each)))
    return max(found, key=lambda f: f[0])[1] if found else None


def shapes(faulty: Track, clean: Track, floor: float) -> tuple[Shape, ...]:
    """All functions, the one to be told first: `none` where none is worth it. `clean`: rows of clean recordings, where
    the same functions may foresee something, too; `floor` [N m]: rms of what is always left."""
    excess = float(np.mean(faulty.left**2)) - floor**2
    if excess < REAL * floor**2 or np.unique(faulty.parts(SPAN_S)).size < 2 * FOLDS:
        return (Shape("none", 0.0),)
    found = [_judged(faulty, clean, family, excess) for family in families(faulty)]
    swings, hertz = momentary.swinging(faulty)
    swings -= momentary.swinging(clean)[0]
    found.append(Shape("swinging", _share(swings / excess), hertz))
    best = max(s.share for s in found)
    told = next(s for s in found if s.share >= best - min(SIMPLER, NEARLY * (1.0 - best)))
    rest = sorted((s for s in found if s is not told), key=lambda s: -s.share)
    if told.share >= WORTH:
        return (told, *rest)
    few = Shape("moments", _share(momentary.moments(faulty, floor) / excess))
    return (few if few.share >= MOST else Shape("none", 0.0), told, *rest)


def _judged(faulty: Track, clean: Track, family: Family, excess: float) -> Shape:
    gone, best = foreseen(faulty, family)
    if gone > 0.0 and np.unique(clean.parts(SPAN_S)).size >= 2 * FOLDS:
        gone -= max(foreseen(clean, family)[0], 0.0)
    return Shape(family.of, _share(gone / excess), family.numbers[best], family.whose)


def _share(x: float) -> float:
    return float(np.clip(x, 0.0, 1.0))
