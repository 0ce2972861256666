"""Weights of working recordings, with the parameters of the machine from its earlier recordings."""

from collections.abc import Mapping, Sequence
from hashlib import sha256

from cylforce.estimation.model import Tares
from cylforce.programs.common.progress import Watch
from cylforce.programs.fleet.gathering import Gathered
from cylforce.programs.fleet.kept import KeptResults
from cylforce.programs.fleet.task import NONE, WORK, Booked, Job, Summary, booked, key_of, tares_key
from cylforce.programs.fleet.workers import Say, Where, computed


def bookings(
    gathered: Sequence[Gathered], kept: KeptResults, where: Where, watch: Watch, say: Say
) -> Mapping[str, Booked]:
    """Return the weights by address; recordings that were already played with these parameters are not played again."""
    found, jobs, keys = dict[str, Booked](), list[tuple[Job, Tares]](), dict[str, str]()
    for each in gathered:
        if each.outcome.facts["state"] != WORK or each.loaded is None:
            continue
        tares = _tares(each, gathered)
        if tares is None:
            reason = "the machine has no recording of the empty machine, from which its parameters would be known"
            found[each.stored.address] = Booked((), (), reason)
            continue
        own = key_of(each.outcome.facts["sha256"], each.loaded.text) + tares_key(tares)
        key = sha256(own.encode()).hexdigest()
        before = kept.get(key)
        if before is not None:
            found[each.stored.address] = Booked(tuple(before.facts["kg"]), tuple(before.facts["errors"]))
            continue
        keys[each.stored.address] = key
        jobs.append((Job(each.stored.address, each.stored.machine_file, each.loaded.text), tares))

    def take(arguments: tuple[Job, Tares], came: Booked | BaseException) -> None:
        address = arguments[0].address
        found[address] = came if isinstance(came, Booked) else NONE._replace(reason=f"{type(came).__name__}: {came}")
        if not found[address].reason:
            kept.put(keys[address], Summary({"kg": found[address].kg, "errors": found[address].errors}))
        watch("weights", len(found) / (len(found) + len(jobs)))

    if jobs:
        watch("weights", 0.0)
        computed(booked, jobs, (), where, take, say)
    return found


def _tares(each: Gathered, gathered: Sequence[Gathered]) -> Tares | None:
    """Return the latest earlier tares of the same machine and machine file, else the first later ones."""
    own = [
        g
        for g in gathered
        if g.stored.machine == each.stored.machine
        and g.outcome.tares is not None
        and g.loaded is not None
        and each.loaded is not None
        and g.loaded.sha256 == each.loaded.sha256
    ]
    own.sort(key=lambda g: (g.made, g.stored.name))
    earlier = [g for g in own if (g.made, g.stored.name) < (each.made, each.stored.name)]
    chosen = earlier[-1:] or own[:1]
    return chosen[0].outcome.tares if chosen else None
