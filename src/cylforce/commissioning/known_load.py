"""A lift of a known weight tells more than a scale: the tares are fitted once more with it, friction under load
included."""

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from cylforce.commissioning.identification import Identification
from cylforce.estimation import blocks, observation
from cylforce.estimation.batch import Prior, least_squares
from cylforce.estimation.blocks import Factors, joined
from cylforce.estimation.model import Model, Tares
from cylforce.estimation.observation import Observed, chunks, observe
from cylforce.estimation.residual import SMALLEST
from cylforce.signals.estimate import Array

# (model, tares, samples (T, S)) -> what hangs in the bucket (T-1,) [kg] at each step; 0 where nothing is known
Hanging = Callable[[Model, Tares, Array], Array]

ALIKE = 0.1  # share of the known weight within which a weight must lie to be it
WRONG_SCALE = 0.01  # standard error of the scale before: areas, levers, gains of the sensors
ENOUGH_SECONDS = 5.0  # of the weight hanging


def with_known_load(
    found: Identification, segments: Iterable[Array], known_kg: float, hanging: Hanging
) -> Identification:
    """The tares and the scale after a lift of `known_kg` in gapless segments of samples (T, S). `hanging`
    tells where the weight hangs.

    With the load's first moments and inertia c and a scale error s unknown, its rows are
    torque - known l_m = W Phi + l_c c + s known l_m: linear, with what the empty machine told as prior.
    Raises ValueError, in a sentence, when the weight is not seen to hang for long enough, or another one is."""
    model, tares = found.model, found.tares
    pieces = [(piece, hanging(model, tares, piece)) for piece in chunks(model, segments)]
    _check_weight(found, np.concatenate([np.zeros(0), *(seen for _, seen in pieces)]), known_kg)
    data = joined((_factors(found, piece, seen, known_kg) for piece, seen in pieces), observation.MOST_BLOCKS)
    size = len(model.parameters)
    fit = least_squares(data, tares.row_error, _before(found))
    error = float(np.sqrt(fit.covariance[-1, -1]))
    fitted = tares._replace(values=fit.values[:size], covariance=fit.covariance[:size, :size])
    return found._replace(tares=fitted._replace(scale=1.0 / (1.0 + float(fit.values[-1])), scale_error=error))


def _check_weight(found: Identification, seen: Array, known_kg: float) -> None:
    """Raises ValueError when `seen` (T,) [kg], what hangs, is not the known weight for long enough."""
    rate = found.model.filters.rate_hz
    if np.sum(_alike(seen, known_kg)) >= ENOUGH_SECONDS * rate:
        return
    hanging = seen[seen > SMALLEST * found.model.machine.rated_payload]
    if hanging.size >= ENOUGH_SECONDS * rate:
        raise ValueError(
            f"what was lifted weighs about {np.median(hanging):.0f} kg, not {known_kg:g} kg: give its true weight, and "
            "lift nothing else"
        )
    raise ValueError(
        f"no lift of {known_kg:g} kg is seen: lift the known weight clear of the ground, move it up and down for at "
        f"least {ENOUGH_SECONDS:.0f} s, set it down"
    )


def _alike(seen: Array, known_kg: float) -> NDArray[np.bool_]:
    return np.asarray(np.abs(seen - known_kg) < ALIKE * known_kg)


def _before(found: Identification) -> Prior:
    """What is known before the lift of Phi (P), c (3) and s."""
    machine, size = found.model.machine, len(found.model.parameters)
    moment = machine.rated_payload * machine.payload_reach
    spread = np.array([moment, moment, moment * machine.payload_reach, WRONG_SCALE])
    covariance = np.zeros((size + 4, size + 4))
    covariance[:size, :size], covariance[size:, size:] = found.tares.covariance, np.diag(spread**2)
    return Prior(np.append(found.tares.values, np.zeros(4)), covariance)


def _factors(found: Identification, values: Array, hanging: Array, known_kg: float) -> Factors:
    """Factors of the rows in which the weight hangs; `hanging` (T-1,) [kg]."""
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
