"""A lift of a known weight: the tares are fitted again with it, including friction under load and the scale of the
forces."""

from collections.abc import Callable, Iterable
from math import hypot

import numpy as np
from numpy.typing import NDArray

from cylforce.commissioning.common_scale import CHECKED
from cylforce.commissioning.emptiness import HEAVY
from cylforce.commissioning.identification import Identification
from cylforce.estimation import blocks, observation
from cylforce.estimation.batch import least_squares
from cylforce.estimation.blocks import Factors, joined
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.observation import Observed, chunks, observe
from cylforce.estimation.priors.prior import Prior
from cylforce.estimation.residual import SMALLEST
from cylforce.signals.estimate import Array

# (model, tares, samples (T, S)) -> estimated load (T-1,) [kg] at each step; 0 where there is no consistent estimate
Hanging = Callable[[Model, Tares, Array], Array]

ALIKE = 0.1  # times the known weight: an estimated load within this difference is taken for the known weight; chosen
WRONG_SCALE = 0.01  # prior standard error of the relative scale error (areas, levers, sensor gains); chosen
ENOUGH_SECONDS = 5.0  # s for which the weight must be seen in the air; chosen


def with_known_load(
    found: Identification, segments: Iterable[Array], known_kg: float, hanging: Hanging
) -> Identification:
    """The identification `found`, with tares and scale fitted again on a lift of `known_kg` [kg]. `segments`: samples
    (T, S) without gaps; `hanging`: function that estimates when the weight is in the air.

    With the load's first moments and inertia c and the scale error s unknown, the rows are
    torque - known l_m = W Phi + l_c c + s known l_m, with l the load's columns. This is linear; the identification of
    the empty machine is the prior.

    Raises ValueError, in one sentence, when the weight is not seen for long enough, or when another weight is seen."""
    model, tares = found.model, found.tares
    pieces = [(piece, hanging(model, tares, piece)) for piece in chunks(model, segments)]
    _check_weight(found, np.concatenate([np.zeros(0), *(seen for _, seen in pieces)]), known_kg)
    data = joined((_factors(found, piece, seen, known_kg) for piece, seen in pieces), observation.MOST_BLOCKS)
    size = len(model.parameters)
    fit = least_squares(data, tares.row_error, _before(found))
    error = float(np.sqrt(fit.covariance[-1, -1]))
    fitted = tares._replace(values=fit.values[:size], covariance=fit.covariance[:size, :size])
    scaled = fitted._replace(scale=1.0 / (1.0 + float(fit.values[-1])), scale_error=error, common_error=0.0)
    question = _question(model, scaled, known_kg)
    return found._replace(tares=scaled, warnings=(*question, *found.warnings))


def _question(model: Model, tares: Tares, known_kg: float) -> tuple[str, ...]:
    """A warning when the known weight moves the scale farther than the data sheet of pressure sensors, bores and pins
    allows: by more than HEAVY standard errors of both."""
    measured = 1.0 / tares.scale
    if abs(measured - 1.0) <= HEAVY * hypot(model.scale_error, tares.scale_error):
        return ()
    sentence = (
        f"the known weight reads {measured * known_kg:.0f} kg, not {known_kg:g} kg: all forces are {measured:.3f} "
        f"times as large, where bores, pins and sensors allow +- {100.0 * model.scale_error:.1f} % (standard error): "
        f"weigh it on a scale; if it is right, check {CHECKED}, bore_mm and pins"
    )
    return (sentence,)


def _check_weight(found: Identification, seen: Array, known_kg: float) -> None:
    """Raises ValueError when the estimated load `seen` (T,) [kg] is not the known weight for long enough."""
    rate = found.model.filters.rate_hz
    if np.sum(_alike(seen, known_kg)) >= ENOUGH_SECONDS * rate:
        return
    hanging = seen[seen > SMALLEST * found.model.machine.rated_payload]
    if hanging.size >= ENOUGH_SECONDS * rate:
        raise ValueError(
            f"what was lifted weighs about {np.median(hanging):.0f} kg, not {known_kg:g} kg: give its true weight, and "
            f"lift nothing else; if it is right, all forces are {np.median(hanging) / known_kg:.2f} times as large as "
            f"it needs: check {CHECKED}"
        )
    raise ValueError(
        f"no lift of {known_kg:g} kg is seen: lift the known weight clear of the ground, move it up and down for at "
        f"least {ENOUGH_SECONDS:.0f} s, set it down"
    )


def _alike(seen: Array, known_kg: float) -> NDArray[np.bool_]:
    return np.asarray(np.abs(seen - known_kg) < ALIKE * known_kg)


def _before(found: Identification) -> Prior:
    """Prior of the parameters Phi (P), the load's first moments and inertia c (3) and the scale error s (1)."""
    machine, size = found.model.machine, len(found.model.parameters)
    moment = machine.rated_payload * machine.payload_reach
    spread = np.array([moment, moment, moment * machine.payload_reach, WRONG_SCALE])
    covariance = np.zeros((size + 4, size + 4))
    covariance[:size, :size], covariance[size:, size:] = found.tares.covariance, np.diag(spread**2)
    return Prior(np.append(found.tares.values, np.zeros(4)), covariance)


def _factors(found: Identification, values: Array, hanging: Array, known_kg: float) -> Factors:
    """Factors of the rows in which the known weight is in the air; `hanging` (T-1,) [kg]: estimated load."""
    model = found.model
    seen, size = observe(model, values), len(model.parameters)
    load, noisy = seen.columns @ model.load, seen.noise[..., :size] @ model.load
    hangs = _alike(hanging, known_kg)[model.settle_steps :]
    observed = np.where(hangs[:, None], seen.torque - known_kg * load[..., 0], np.nan)
    columns = np.concatenate([seen.columns, load[..., 1:], known_kg * load[..., :1]], axis=-1)
    shift = seen.noise[..., -1:] - known_kg * noisy[..., :1]
    noise = np.concatenate([seen.noise[..., :size], noisy[..., 1:], known_kg * noisy[..., :1], shift], axis=-1)
    rows = blocks.BlockRows(columns, observed, noise, seen.certain, _mark(seen))
    return blocks.row_factors(rows, int(observation.BLOCK_SECONDS * model.filters.rate_hz))


def _mark(seen: Observed) -> Array:
    return np.concatenate([seen.posture, np.abs(seen.speed)], axis=1)
