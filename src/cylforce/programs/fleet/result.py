"""Result of a run of `cylforce fleet`."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from cylforce.fleet.changes import MachineChange
from cylforce.programs.fleet.analysis import Analysis
from cylforce.programs.fleet.gathering import Gathered


class FleetChange(NamedTuple):
    """Change of a machine.

    machine: its name
    altered: the change
    date:    date of the first recording with it
    before:  date of the recording before
    words:   a sentence
    """

    machine: str
    altered: MachineChange
    date: str
    before: str
    words: str


class FleetResult(NamedTuple):
    """Result of a run.

    gathered: recordings with their results
    analysis: of all types
    changes:  of all machines
    rows:     of the table
    notes:    sentences about the whole
    """

    gathered: Sequence[Gathered]
    analysis: Analysis
    changes: tuple[FleetChange, ...]
    rows: Sequence[Mapping[str, Any]]
    notes: tuple[str, ...]
