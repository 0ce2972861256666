"""Which cases are still to be asked, and asking them, machine by machine, in several processes."""

import json
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.progress import track

from .knowledge import Limited
from .orders import Order
from .repertoire import drawn
from .run import Trial, run_machine
from .source import Labelled, labelled, orders, source_records

Record = dict[str, Any]
Work = Callable[[], int]


@dataclass(frozen=True)
class Asked:
    """The order of every case by its name, the words that a stratum may be called by, and the work on a machine's
    cases, given their names."""

    orders: dict[str | int, Record]
    words: dict[str | int, set[str]]
    machine: Callable[[Sequence[str | int]], Work]

    def stratum(self, words: Sequence[str]) -> "Asked":
        """The cases that all of the words hold for. Raises ValueError where none is left."""
        found = {name: order for name, order in self.orders.items() if set(words) <= self.words[name]}
        if not found:
            known = ", ".join(sorted(set[str]().union(*self.words.values())))
            raise ValueError(f"no case is {' and '.join(words)}: words are {known}")
        return replace(self, orders=found)


def of_machines(trial: Trial, wanted: Sequence[Order]) -> Asked:
    """Cases of reference machines."""
    by_name = {order.number: order for order in wanted}

    def machine(names: Sequence[str | int]) -> Work:
        return partial(run_machine, trial, [by_name[int(name)] for name in names])

    words: dict[str | int, set[str]] = {o.number: _words(o) for o in wanted}
    return Asked({o.number: json.loads(json.dumps(asdict(o))) for o in wanted}, words, machine)


def _words(order: Order) -> set[str]:
    """Kind, effects, motion of the machine's field, whether with clutter, what is lacking."""
    motion = drawn(order.machine).field[0].kind
    motion = "strokes" if order.poor or (order.two_links and motion == "work") else motion
    asked = {"left_out"} if order.without else set[str]()
    size = {"clutter" if order.clutter else "clean"} if order.kind == "known" else set[str]()
    return {order.kind, *order.names, motion} | asked | size | ({order.poor} - {""})


def of_folder(trial: Trial, folder: Path, prefixes: tuple[str, ...]) -> Asked:
    """Cases of labelled machines. Raises OSError, ValueError or KeyError where the folder lacks something."""
    found = labelled(folder)
    pairs = zip(found, orders(found), strict=True)
    by_name = {order["case"]: (each, order) for each, order in pairs if each.key[1].startswith(prefixes)}

    def machine(names: Sequence[str | int]) -> Work:
        return partial(ask_folder, trial, [by_name[str(name)] for name in names])

    words = {
        name: {each.kind, each.truth[0], str(each.label["scenario"])} - {""} for name, (each, _) in by_name.items()
    }
    return Asked({name: order for name, (_, order) in by_name.items()}, words, machine)


def ask_folder(trial: Trial, asked: Sequence[tuple[Labelled, Record]]) -> int:
    """Cases of one labelled machine."""
    with Limited(trial.knowledge) as limited:
        for record in source_records(trial.diagnosis, asked, limited):
            trial.append(record)
    return len(asked)


def run(trial: Trial, asked: Asked, workers: int) -> list[str | int]:
    """Asks the cases that the table lacks; those that are missing still."""
    known = {r["case"]: r["order"] for r in trial.done()}
    if any(known[name] != order for name, order in asked.orders.items() if name in known):
        raise SystemExit(f"withheld_trial: {trial.table} holds other cases: give another --table or remove it")
    left = [name for name in asked.orders if name not in known]
    work = [asked.machine(names) for names in machines(asked, left)]
    with ProcessPoolExecutor(workers) as pool:
        futures = [pool.submit(each) for each in work]
        for done in track(as_completed(futures), f"{len(left)} cases", total=len(futures)):
            if error := done.exception():
                print(f"withheld_trial: a machine's cases stopped: {error!r}", file=sys.stderr)
    had = {r["case"] for r in trial.done()}
    return [name for name in asked.orders if name not in had]


def machines(asked: Asked, names: Iterable[str | int]) -> Iterator[list[str | int]]:
    """Names of the cases of one machine after the other."""
    for _, group in groupby(names, key=lambda name: asked.orders[name]["machine"]):
        yield list(group)
