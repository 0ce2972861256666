"""A label and the answer to it: what was there, what was said, with which probability.

A label has `kind`, `clutter`, `scenario`, `effects` [{name, at, over_floor}]; an answer is the diagnosis' JSON. Its
`set` and `probabilities` are read where it has them; an answer without them says the same by its first effect, that
effect's confidence and what it is confused with."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

Record = dict[str, Any]
Place = tuple[str, str]
SILENT = ("no_gap", "not_observable")
NAMED = ("explained", "partly_explained", "ambiguous")
NO_GAP, UNKNOWN = ("no_gap", ""), ("unknown", "")
SAID = {"unknown": (UNKNOWN,), "no_gap": (NO_GAP,), "not_observable": (NO_GAP,)}  # by a verdict without a name
VISIBLE = 2.5  # times the floor: residual with the effect, at the joint where it leaves most
# What a data sheet does not know: without references this is the difference, on a machine in order too.
UNKNOWN_TO_A_SHEET = (
    *("coulomb_friction", "viscous_friction", "load_dependent_friction", "asymmetric_friction"),
    "first_moment_change",
)
DIGGING = "dig_cycles"  # how scenarios of normal work begin


class Share(NamedTuple):
    """`hits` of `cases`."""

    hits: int
    cases: int

    @property
    def value(self) -> float | None:
        """The share, None of nothing."""
        return self.hits / self.cases if self.cases else None


def share(cases: Iterable["Judged"], holds: Callable[["Judged"], bool]) -> Share:
    """Share of the cases for which something is true."""
    found = [holds(case) for case in cases]
    return Share(sum(found), len(found))


@dataclass(frozen=True)
class Judged:
    """A label and the answer to it."""

    label: Record
    answer: Record

    @property
    def kind(self) -> str:
        """Known, none, foreign, pair, poor or without (the effect is left out of the library)."""
        return str(self.label["kind"])

    @property
    def truths(self) -> list[set[Place]]:
        """Of every effect the (name, at) that are right; an effect may sit at several places."""
        return [{(e["name"], at) for at in e.get("places") or (e["at"],)} for e in self.label["effects"]]

    @property
    def truth(self) -> set[Place]:
        """(name, at) of every effect."""
        return set[Place]().union(*self.truths)

    @property
    def effects(self) -> list[Record]:
        """The answer's effects, the likeliest first."""
        return list(self.answer.get("effects") or [])

    @property
    def detected(self) -> bool:
        """Any verdict but no gap and not observable."""
        return self.answer["verdict"] not in SILENT

    @property
    def named(self) -> bool:
        """The answer gives at least one name."""
        return self.answer["verdict"] in NAMED and bool(self.effects)

    @property
    def one(self) -> bool:
        """The answer gives exactly one cause."""
        return self.named and self.answer["verdict"] != "ambiguous" and len(self.effects) == 1

    @property
    def right(self) -> bool:
        """The first effect is a true one, at its place."""
        return bool(self.effects) and place(self.effects[0]) in self.truth

    @property
    def joint_right(self) -> bool:
        """Whether the first effect that is named is at the joint, or a sensor of the joint, of a true one."""
        named = str(self.effects[0]["at"]).partition("_")[0]
        return named in {at.partition("_")[0] for _, at in self.truth}

    @property
    def present(self) -> set[Place]:
        """(name, at) of every effect that is there to be seen: also of one of the clutter, if the answer names it first
        and it is as large as what must be seen; of what a data sheet does not know, where that is all there is to
        compare with."""
        small, found = self.label.get("present"), self.truth
        if small and self._visible(small):
            found |= {place(small)}
        if not self.has_model:
            found |= {p for p in (*map(place, self.effects), *self.probabilities) if p[0] in UNKNOWN_TO_A_SHEET}
        return found

    @property
    def alarm(self) -> bool:
        """Something is wrong, it says, that is not there."""
        return self.detected and not (self.named and {place(e) for e in self.effects} <= self.present)

    @property
    def wrong(self) -> bool:
        """A name is given, and the first is none of those that are there. What the library lacked when a label was made
        may be named rightly since."""
        return self.named and place(self.effects[0]) not in self.present

    @property
    def listed(self) -> set[Place]:
        """All effects that the answer leaves possible."""
        found = {place(e) for e in self.effects}
        if self.answer["verdict"] == "ambiguous":
            found = {place(e) for e in self.effects[:1]}
            found |= {place(e) for e in (self.effects[0].get("confused_with") or [])}
        return found

    @property
    def possible(self) -> set[Place]:
        """The smallest set that holds the cause with 90 %; no gap and unknown may be among its members."""
        if "set" in self.answer:
            return {place(member) for member in self.answer["set"]}
        if self.named:
            return {place(self.effects[0])} | {place(e) for e in self.effects[0].get("confused_with") or []}
        return set(SAID.get(self.answer["verdict"], ()))

    @property
    def covered(self) -> bool:
        """Whether every effect is in the set, or among several that are named."""
        found = self.possible | self.listed | {place(e) for e in self.effects if self.named}
        return all(each & found for each in self.truths)

    @property
    def visible(self) -> bool:
        """Whether the residual with every true effect alone is well above the floor."""
        return bool(self.label["effects"]) and all(self._visible(e) for e in self.label["effects"])

    @staticmethod
    def _visible(effect: Record) -> bool:
        return bool(effect["over_floor"] >= VISIBLE)

    @property
    def has_model(self) -> bool:
        """Whether the diagnosis has references or an identification, and not the data sheet alone."""
        return bool(self.label.get("references", True))

    @property
    def digging(self) -> bool:
        """Whether the field is normal work."""
        return str(self.label.get("scenario", "")).startswith(DIGGING)

    @property
    def answers(self) -> set[Place]:
        """What would have been the right hypothesis: no gap, an effect, or unknown where the library lacks it."""
        if self.kind == "none":
            return self.present | {NO_GAP}
        return self.present | ({UNKNOWN} if self.kind in ("foreign", "without") else set())

    @cached_property
    def probabilities(self) -> dict[Place, float]:
        """Of the hypotheses, as stated; empty where nothing was."""
        stated = self.answer.get("probabilities")
        if stated:
            found = {place(e): float(e["probability"]) for e in stated.get("effects") or []}
            return found | {NO_GAP: float(stated["no_gap"]), UNKNOWN: float(stated["unknown"])}
        if self.named and "confidence" in self.effects[0]:
            return {place(self.effects[0]): float(self.effects[0]["confidence"])}
        return {}

    @property
    def first(self) -> Place | None:
        """The likeliest hypothesis."""
        return max(self.probabilities, key=lambda k: self.probabilities[k]) if self.probabilities else None

    @property
    def confidence(self) -> float:
        """Probability of the first name that is given; 0 where none is."""
        if not self.named:
            return 0.0
        return self.probabilities.get(place(self.effects[0]), float(self.effects[0].get("confidence", 0.0)))


def place(effect: Record) -> Place:
    """(name, at)."""
    return str(effect["name"]), str(effect["at"])
