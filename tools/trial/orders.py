"""Which case is which: kinds in the trial's mix, machines, effects. Pure functions of seed and number."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from .effects.foreign import FOREIGN
from .effects.library import BOOM_MOTION, KNOWN
from .effects.unheard import UNHEARD

KINDS = ("known",) * 8 + ("none",) * 5 + ("foreign",) * 3 + ("pair",) * 2 + ("poor",) * 2  # of twenty cases
POOR = ("short", "one_joint", "slow", "empty_only", "no_load")
PER_MACHINE = 8  # cases that share a machine and its clean recordings
FIRST_SCORED = 500_000  # machines below are for development
PER_SEED, SEEDS = 1000, 499  # machines of a seed
NAMES = (*KNOWN, BOOM_MOTION)
NONE_OF_TWO_LINKS = 8  # one of so many cases without an effect is a system of stick and bucket alone
CONDITIONS = ("usual", "harsh")  # of cases without an effect: cold oil on a steep slope, every other one


@dataclass(frozen=True)
class Order:
    """A case.

    number:    of the case
    kind:      of KINDS
    names:     of its effects
    clutter:   whether small other effects are added
    poor:      what its motion lacks, of POOR; empty if nothing
    machine:   seed of its machine
    friction:  law of the friction there
    seed:      of its own random numbers
    two_links: whether the machine has stick and bucket alone
    without:   whether it is diagnosed once more with its effect left out of the library
    harsh:     whether the healthy machine works with cold oil on a steep slope
    """

    number: int
    kind: str
    names: tuple[str, ...]
    clutter: bool
    poor: str
    machine: int
    friction: str
    seed: tuple[int, ...]
    two_links: bool = False
    without: bool = False
    harsh: bool = False


def order(seed: int, number: int, *, development: bool) -> Order:
    """Case `number` of a seed; development and scored machines never share a seed."""
    machine = machine_seed(seed, number // PER_MACHINE, development=development)
    kind = _shuffled(seed, 0, number // len(KINDS), KINDS)[number % len(KINDS)]
    before = sum(_kind(seed, k) == kind for k in range(number))
    own = (seed, number, int(development))
    return Order(
        number=number,
        kind=kind,
        names=_names(seed, kind, before),
        clutter=kind == "known" and _flip(seed, before),
        poor=_cycle(seed, 1, POOR, before) if kind == "poor" else "",
        machine=machine,
        two_links=_two_links(seed, kind, before),
        friction=("own", "foreign")[int(np.random.default_rng([machine, 77]).integers(2))],
        seed=own,
        without=kind == "known" and before < len(NAMES),
        harsh=kind == "none" and _cycle(seed, 8, CONDITIONS, before) == "harsh",
    )


def machine_seed(seed: int, place: int, *, development: bool) -> int:
    """Seed of a machine: development < 500 000 <= scored."""
    if not 0 <= place < PER_SEED:
        raise ValueError(f"a seed has {PER_SEED * PER_MACHINE} cases at most: give another --seed")
    return (0 if development else FIRST_SCORED) + (seed % SEEDS) * PER_SEED + place


def _kind(seed: int, number: int) -> str:
    return _shuffled(seed, 0, number // len(KINDS), KINDS)[number % len(KINDS)]


@cache
def _shuffled(seed: int, stream: int, block: int, members: tuple[str, ...]) -> tuple[str, ...]:
    rng = np.random.default_rng([seed, stream, block])
    return tuple(members[k] for k in rng.permutation(len(members)).tolist())


def _cycle(seed: int, stream: int, members: tuple[str, ...], index: int) -> str:
    """Members in random order; each comes once before any comes again."""
    return _shuffled(seed, stream, index // len(members), members)[index % len(members)]


def _flip(seed: int, index: int) -> bool:
    """True for one of every two."""
    return _cycle(seed, 2, ("clean", "clutter"), index) == "clutter"


def _two_links(seed: int, kind: str, index: int) -> bool:
    """Whether the machine has two links only. So have some cases without an effect: two links give no effect away."""
    if kind == "none":
        return _cycle(seed, 7, ("two", *("three",) * (NONE_OF_TWO_LINKS - 1)), index) == "two"
    return _names(seed, kind, index) == (BOOM_MOTION,)


def _names(seed: int, kind: str, index: int) -> tuple[str, ...]:
    if kind == "none":
        return ()
    if kind == "foreign":
        return (_cycle(seed, 3, tuple((FOREIGN, UNHEARD)[index % 2]), index // 2),)
    if kind == "known":
        return (_cycle(seed, 4, NAMES, index),)
    if kind == "poor":
        return (_cycle(seed, 5, tuple(KNOWN), index),)
    rng = np.random.default_rng([seed, 6, index])
    return tuple(str(name) for name in rng.choice(tuple(KNOWN), 2, replace=False))
