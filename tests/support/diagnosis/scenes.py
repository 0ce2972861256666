"""Short recordings of small simulated machines, each made once a session, and what is learnt of them.

Masses of the true machine differ from the machine file by ten per cent; a seed names the motion and the noise."""

from functools import cache

import numpy as np

from cylforce.diagnosis import Diagnosis, diagnose, question_of
from cylforce.diagnosis.model import HealthyMachine, KnowledgeSource, fitted_parameters, learnt
from cylforce.diagnosis.regressors import Regressors
from cylforce.diagnosis.search import FieldQuestion, Key
from cylforce.effects.geometry.linkage_geometry import LinkageGeometry
from cylforce.effects.imposed import Imposed, imposed
from cylforce.effects.library import LIBRARY, Proposal, proposals
from cylforce.effects.unknown import UNKNOWN_TORQUES
from cylforce.estimation.model import FRICTION, Model
from cylforce.readings.recording import Recording
from cylforce.settings.machine_file import load
from cylforce.simulation.scenario import cycles, moves
from cylforce.simulation.sensing import perfect, run, sensors
from cylforce.simulation.simulator import draw_truth
from scenarios import CONFIG

SERVICE = load(CONFIG / "excavator_stick_bucket.toml").service  # two joints: half as many columns as an excavator's
MACHINE, RATE_HZ = SERVICE.machine, SERVICE.filters.rate_hz
SENSOR_NOISE = np.array([s.standard_error for s in MACHINE.signals])
MASS_ERROR = 0.1  # of the true machine
REFERENCE_SEEDS = (1, 2)
SECONDS = 60.0
NAMES = (  # one or two effects of every kind, and their rivals: half of the library is twice as quick
    *("coulomb_friction", "viscous_friction", "friction_level_change", "stribeck", "return_line_loss"),
    *("pressure_offset", "pressure_gain", "angle_offset", "angle_scale", "sensor_delay", "linkage_geometry"),
    *("extra_mass", "first_moment_change", "hose_spring", "compliance", "clock_fault"),
    *("soil_contact", "slew_centrifugal", "payload_spill", "payload_shift"),
)
FIRST_FORMS = {group[0].about.name: group for group in reversed(LIBRARY)}
OTHER_PINS = tuple(group for group in LIBRARY if group[0] == LinkageGeometry(1))
PROPOSALS = (
    *proposals(MACHINE, (*(FIRST_FORMS[name] for name in NAMES), *OTHER_PINS)),
    *proposals(MACHINE, UNKNOWN_TORQUES),
)


def effect(name: str, at: str, value: float | list[float], **more: float | dict[str, float]) -> Imposed:
    """Return an effect of the library on the small machine."""
    return imposed(MACHINE, name, at, value, **more)


@cache
def recorded(
    seed: int,
    *effects: Imposed,
    seconds: float = SECONDS,
    load_kg: float = 0.0,
    name: str = "",
    noise: bool = True,
) -> Recording:
    """Return a recording of the machine with effects; motion and noise are drawn from `seed`."""
    truth = draw_truth(MACHINE, np.random.default_rng(0), MASS_ERROR)._replace(effects=effects)
    scene = moves(MACHINE, np.random.default_rng((seed, 1)), seconds, payload=load_kg)
    made, rng = sensors(MACHINE, SERVICE.nodes) if noise else perfect(MACHINE), np.random.default_rng((seed, 9))
    (record,) = run(MACHINE, truth, made, [scene], dt=1.0 / RATE_HZ, rng=rng)
    return Recording(name or f"run {seed}", record.values, load_kg, 0.0)


@cache
def dug(seed: int, *effects: Imposed, count: int = 4) -> Recording:
    """Return digging cycles of the machine with effects; every bucket is another load, unknown to the diagnosis."""
    truth = draw_truth(MACHINE, np.random.default_rng(0), MASS_ERROR)._replace(effects=effects)
    scenes = list(cycles(MACHINE, np.random.default_rng((seed, 2)), count, swing=False))
    made, rng = sensors(MACHINE, SERVICE.nodes), np.random.default_rng((seed, 8))
    records = run(MACHINE, truth, made, scenes, dt=1.0 / RATE_HZ, rng=rng)
    return Recording(f"dug {seed}", np.concatenate([record.values for record in records]))


def learnt_from(
    *recordings: Recording, wanted: tuple[Proposal, ...] = PROPOSALS, source=KnowledgeSource.REFERENCES
) -> HealthyMachine:
    """Return what recordings say of the healthy machine."""
    model = Model(MACHINE, SERVICE.filters, FRICTION)
    regressors = Regressors(model, fitted_parameters(model, recordings))
    return learnt(regressors, wanted, recordings, SENSOR_NOISE, np.random.default_rng(1), source)


@cache
def healthy_machine() -> HealthyMachine:
    """Return the machine that two references show; made once a session."""
    return learnt_from(*(recorded(seed) for seed in REFERENCE_SEEDS))


@cache
def asked(*recordings_of: tuple[int, tuple[Imposed, ...]]) -> FieldQuestion:
    """Return recordings, by seed and effects, beside the healthy machine."""
    field = [recorded(seed, *effects) for seed, effects in recordings_of]
    return question_of(healthy_machine(), field, np.random.default_rng(1))


@cache
def diagnosed(*recordings_of: tuple[int, tuple[Imposed, ...]]) -> Diagnosis:
    """Return the diagnosis of recordings, by seed and effects, beside the healthy machine."""
    field = [recorded(seed, *effects) for seed, effects in recordings_of]
    return diagnose(healthy_machine(), field, np.random.default_rng(1))


def names(found: Diagnosis) -> list[Key]:
    """Return name and place of the causes that are named."""
    return [named.cause.key for named in found.named]
