"""Healthy machine with which `cylforce gap` compares the field recordings, from one of several sources.

The sources are recordings of the healthy machine (--reference), recordings of the user's own simulation (--simulation),
an identification (--identified), and the spread of the type (--usual). A data sheet alone is no healthy machine.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cylforce.diagnosis.model import (
    HealthyMachine,
    KnowledgeSource,
    fitted_parameters,
    identified,
    learnt,
    with_proposals,
    with_variation,
)
from cylforce.diagnosis.regressors import Regressors
from cylforce.diagnosis.statistics import rms
from cylforce.effects.library import LIBRARY, Group, Proposal, proposals
from cylforce.effects.unknown import UNKNOWN_TORQUES
from cylforce.estimation.model import FRICTION, Model, Tares
from cylforce.programs.common.gap_question import Question
from cylforce.programs.common.machine_statistics import read_statistics, statistics_path
from cylforce.programs.common.progress import Watch
from cylforce.programs.common.statistics_cache import StatisticsCache, key_of
from cylforce.programs.common.usual_file import everyday_of, usual_parameters
from cylforce.readings.jumps import NAME as JUMPS
from cylforce.readings.noise import usual_noise
from cylforce.readings.recording import Recording
from cylforce.settings.identified import read_identified
from cylforce.settings.machine_file import Loaded
from cylforce.signals.estimate import Array
from cylforce.signals.parallel import ParallelMap, sequential_map

# Friction laws that the model of a diagnosis has; `stribeck` only where it was identified, since it is also an effect.
ALWAYS = ("coulomb", "viscous", "delay", "load_dependent", "directional")
# Friction laws fitted beside the masses of a data sheet. Those that depend on load or direction resemble gravity: with
# them the fit predicts other recordings of the real crane worse (remaining torque 397 instead of 206 N m).
OF_SHEET = ("coulomb", "viscous", "delay")


# Share of the torque at every joint: references that leave more show no healthy machine. Convention between the 0.004
# of own simulated machines in the air and the 0.2 of one at work with unknown loads.
MOST_UNEXPLAINED = 0.05


@dataclass(frozen=True)
class Known:
    """Healthy machine of a diagnosis.

    machine:    the healthy machine
    identified: whether its parameters are certainly this machine's
    warnings:   sentences
    """

    machine: HealthyMachine
    identified: bool
    warnings: tuple[str, ...] = ()


def unexplained(machine: HealthyMachine, recordings: Sequence[Recording]) -> float:
    """Return the noise floor of a machine as a share of the torque in its recordings, at the joint with the least."""
    parameters, torques = machine.regressors.parameters, []
    for each in recordings:
        rows = machine.regressors.rows(each, ())
        torques.append(rows.base @ parameters + rows.residual)
    torque = rms(torques)
    moved = machine.known & (torque > 0.0)
    return float(np.min(machine.floor.rms[moved] / torque[moved])) if np.any(moved) else 0.0


@dataclass(frozen=True)
class Groups:
    """Recordings of a diagnosis.

    field:   of the machine that differs
    healthy: of the healthy machine, or of its simulation
    """

    field: Sequence[Recording]
    healthy: Sequence[Recording]


def lasting_proposals(loaded: Loaded, library: tuple[Group, ...]) -> tuple[Proposal, ...]:
    """Return all effects at their locations that do not depend on a recording, and the unknown torques.

    Jumps of readings are excluded: their effect is made of the jumps in a recording.
    """
    machine = loaded.service.machine
    return (
        *proposals(machine, tuple(group for group in library if group[0].about.name != JUMPS)),
        *proposals(machine, UNKNOWN_TORQUES),
    )


def learnt_machine(
    loaded: Loaded,
    recordings: Sequence[Recording],
    library: tuple[Group, ...],
    tares: Tares | None,
    cache: StatisticsCache | None = None,
    field: Sequence[Recording] | None = None,
    parallel_map: ParallelMap = sequential_map,
) -> HealthyMachine:
    """Return the healthy machine that recordings show.

    tares:        identified parameters; None: fitted to the recordings
    field:        recordings of the machine that differs, where the others are of a simulation without sensors; None:
                  they are of the machine
    parallel_map: maps a function, perhaps in parallel
    """
    service, each = loaded.service, lasting_proposals(loaded, library)
    laws = ALWAYS if tares is None else (*ALWAYS, *tares.friction)
    model = Model(service.machine, service.filters, tuple(law for law in FRICTION if law in laws))
    parameters = fitted_parameters(model, recordings) if tares is None else with_all_laws(model, tares)
    regressors = Regressors(model, parameters)
    source = KnowledgeSource.REFERENCES if field is None else KnowledgeSource.SIMULATION
    noise = usual_noise(service.machine, recordings if field is None else field)
    key = key_of(loaded.sha256, regressors, each, recordings, noise, source) if cache else ""
    if cache and (found := cache.get(key, regressors, each)):
        return found
    machine = learnt(
        regressors, each, recordings, noise, np.random.default_rng(SEED), source, parallel_map=parallel_map
    )
    if cache:
        cache.put(key, machine)
    return machine


SEED = 1  # of the sensor noise that is simulated, of the bootstrap


def known_machine(
    loaded: Loaded,
    question: Question,
    groups: Groups,
    library: tuple[Group, ...],
    watch: Watch,
    cache: StatisticsCache | None = None,
    parallel_map: ParallelMap = sequential_map,
) -> Known | None:
    """Return the healthy machine of a question; None if there is only a data sheet. Raises SettingsError."""
    tares = None if question.identified is None else read_identified(question.identified, loaded)
    known = None
    if groups.healthy:
        watch("learning the healthy machine", None)
        field = groups.field if question.simulation else None
        known = Known(
            learnt_machine(loaded, groups.healthy, library, tares, cache, field, parallel_map), tares is not None
        )
    elif tares is not None and question.identified is not None:
        known = _identified_machine(loaded, question.identified, tares, groups.field, library)
    elif question.usual is not None:
        known = _usual_machine(loaded, question.usual, groups.field, library)
    if known is None or question.usual is None:
        return known
    everyday = everyday_of(question.usual, loaded.service.machine)
    return Known(with_variation(known.machine, everyday), known.identified, known.warnings)


def _identified_machine(
    loaded: Loaded, path: Path, tares: Tares, field: Sequence[Recording], library: tuple[Group, ...]
) -> Known:
    """Return the machine of an identified.toml, with the statistics beside it if they fit."""
    service, each = loaded.service, lasting_proposals(loaded, library)
    found, reason = read_statistics(statistics_path(path), loaded, tares, lasting_proposals(loaded, LIBRARY))
    if found is not None:
        known = set(found.layout.proposals)
        return Known(with_proposals(found, [p for p in each if p not in known]), identified=True)
    # The noise floor is the residual with the identification's own laws: the model has no others.
    regressors = Regressors(Model(service.machine, service.filters, tares.friction), tares.values)
    noise, rng = usual_noise(service.machine, field), np.random.default_rng(SEED)
    machine = identified(regressors, each, tares.covariance, tares.row_error, field, noise, rng)
    return Known(machine, identified=True, warnings=(reason,))


def _usual_machine(loaded: Loaded, path: Path, field: Sequence[Recording], library: tuple[Group, ...]) -> Known:
    """Return a machine with the mean and spread of its type; its noise floor is the residual of a fit to the field."""
    service, each = loaded.service, lasting_proposals(loaded, library)
    model = Model(service.machine, service.filters, ALWAYS, usual_parameters(path, service.machine))
    fitted = Regressors(model, fitted_parameters(model, field))
    floor = rms([fitted.rows(recording, ()).residual for recording in field])
    noise, rng = usual_noise(service.machine, field), np.random.default_rng(SEED)
    covariance, floor = model.prior.covariance, np.where(floor > 0.0, floor, 1.0)
    machine = identified(Regressors(model, model.prior.mean), each, covariance, floor, field, noise, rng)
    return Known(machine, identified=True)


def with_all_laws(model: Model, tares: Tares) -> Array:
    """Return identified parameters (P,) for a model with more friction laws; those of absent laws are 0."""
    known = dict(zip(tares.names, tares.values.tolist(), strict=True))
    return np.array([known.get(p.name, 0.0) for p in model.parameters])
