"""Fit the tares again with a lift of a known weight, which shows friction under load and the scale of the forces."""

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
from cylforce.estimation.residual import EMPTY_BELOW
from cylforce.signals.estimate import Array

# (model, tares, samples (T, S)) -> estimated load (T-1,) [kg] at each step; 0 where there is no consistent estimate.
# An argument, because the estimator belongs to the service, which stands beside this room.
LoadEstimator = Callable[[Model, Tares, Array], Array]

ALIKE = 0.1  # difference within which an estimated load is taken for the known weight, times that weight; chosen
WRONG_SCALE = 0.01  # prior standard error of the relative scale error (areas, levers, sensor gains); chosen
ENOUGH_SECONDS = 5.0  # s for which the weight must be in the air; chosen


def with_known_load(
    empty: Identification, segments: Iterable[Array], known_kg: float, estimate_load: LoadEstimator
) -> Identification:
    """Return an identification with tares and scale fitted again on a lift of a known weight.

    With the load's first moments and inertia c and the scale error s unknown, the rows are torque - known l_m = W Phi +
    l_c c + s known l_m, with l the load's columns. This is linear; the identification of the empty machine is the
    prior. The scale of the tares becomes 1/(1 + s); an implausible one adds a warning. Raises ValueError, in one
    sentence, when the weight does not appear for long enough, or when another weight does.

    empty: identification of the empty machine
    segments: samples (T, S) without gaps [SI]
    known_kg: the known weight [kg]
    estimate_load: function (model, tares, samples) that returns the load (T-1,) [kg] at each step
    """
    model, tares = empty.model, empty.tares
    pieces = [(piece, estimate_load(model, tares, piece)) for piece in chunks(model, segments)]
    _check_weight(empty, np.concatenate([np.zeros(0), *(load for _, load in pieces)]), known_kg)
    data = joined((_factors(empty, piece, load, known_kg) for piece, load in pieces), observation.MOST_BLOCKS)
    size = len(model.parameters)
    fit = least_squares(data, tares.row_error, _prior(empty))
    error = float(np.sqrt(fit.covariance[-1, -1]))
    fitted = tares._replace(values=fit.values[:size], covariance=fit.covariance[:size, :size])
    scaled = fitted._replace(scale=1.0 / (1.0 + float(fit.values[-1])), scale_error=error, common_error=0.0)
    question = _question(model, scaled, known_kg)
    return empty._replace(tares=scaled, warnings=(*question, *empty.warnings))


def _question(model: Model, tares: Tares, known_kg: float) -> tuple[str, ...]:
    """Return a warning when the known weight moves the scale farther than pressure sensors, bores and pins allow, else
    ().

    The limit is HEAVY standard errors of the data sheet's scale and of the measured one together.

    tares: with the scale that the known weight gave
    known_kg: the known weight [kg]
    """
    measured = 1.0 / tares.scale
    if abs(measured - 1.0) <= HEAVY * hypot(model.scale_error, tares.scale_error):
        return ()
    sentence = (
        f"the known weight reads {measured * known_kg:.0f} kg, not {known_kg:g} kg: all forces are {measured:.3f} "
        f"times as large, where bores, pins and sensors allow +- {100.0 * model.scale_error:.1f} % (standard error): "
        f"weigh it on a scale; if it is right, check {CHECKED}, bore_mm and pins"
    )
    return (sentence,)


def _check_weight(empty: Identification, loads: Array, known_kg: float) -> None:
    """Raise ValueError when the estimated load is not the known weight for long enough (ENOUGH_SECONDS).

    The sentence says whether another weight was lifted that long, or none.

    loads: (T,) estimated load [kg]
    """
    rate = empty.model.filters.rate_hz
    if np.sum(_alike(loads, known_kg)) >= ENOUGH_SECONDS * rate:
        return
    lifted = loads[loads > EMPTY_BELOW * empty.model.machine.rated_payload]
    if lifted.size >= ENOUGH_SECONDS * rate:
        raise ValueError(
            f"what was lifted weighs about {np.median(lifted):.0f} kg, not {known_kg:g} kg: give its true weight, and "
            f"lift nothing else; if it is right, all forces are {np.median(lifted) / known_kg:.2f} times as large as "
            f"it needs: check {CHECKED}"
        )
    raise ValueError(
        f"no lift of {known_kg:g} kg is seen: lift the known weight clear of the ground, move it up and down for at "
        f"least {ENOUGH_SECONDS:.0f} s, set it down"
    )


def _alike(loads: Array, known_kg: float) -> NDArray[np.bool_]:
    """Return whether each estimated load (T,) [kg] is taken for the known weight."""
    return np.asarray(np.abs(loads - known_kg) < ALIKE * known_kg)


def _prior(empty: Identification) -> Prior:
    """Return the prior of P + 4 parameters: Phi (P), the load's first moments and inertia c (3), the scale error s.

    Phi has the values and covariance of the empty machine's tares; c [kg m, kg m, kg m^2] and s have means of zero.
    """
    machine, size = empty.model.machine, len(empty.model.parameters)
    moment = machine.rated_payload * machine.payload_reach
    spread = np.array([moment, moment, moment * machine.payload_reach, WRONG_SCALE])
    covariance = np.zeros((size + 4, size + 4))
    covariance[:size, :size], covariance[size:, size:] = empty.tares.covariance, np.diag(spread**2)
    return Prior(np.append(empty.tares.values, np.zeros(4)), covariance)


def _factors(empty: Identification, values: Array, loads: Array, known_kg: float) -> Factors:
    """Return the factors of the rows in which the known weight is in the air.

    values: samples (T, S) [SI]
    loads: (T-1,) estimated load [kg]
    """
    model = empty.model
    rows, size = observe(model, values), len(model.parameters)
    load_columns, load_noise = rows.columns @ model.load, rows.noise[..., :size] @ model.load
    in_air = _alike(loads, known_kg)[model.settle_steps :]
    # observed: torque - known l_m; columns: W, l_c, known l_m; the sensors' noise in them likewise
    observed = np.where(in_air[:, None], rows.torque - known_kg * load_columns[..., 0], np.nan)
    columns = np.concatenate([rows.columns, load_columns[..., 1:], known_kg * load_columns[..., :1]], axis=-1)
    noise = np.concatenate(
        [
            rows.noise[..., :size],
            load_noise[..., 1:],
            known_kg * load_noise[..., :1],
            rows.noise[..., -1:] - known_kg * load_noise[..., :1],
        ],
        axis=-1,
    )
    block_rows = blocks.BlockRows(columns, observed, noise, rows.certain, _mark(rows))
    return blocks.row_factors(block_rows, int(observation.BLOCK_SECONDS * model.filters.rate_hz))


def _mark(rows: Observed) -> Array:
    """Return the quantities averaged over each block: posture (N) and size of the cylinder speeds (C)."""
    return np.concatenate([rows.posture, np.abs(rows.speed)], axis=1)
