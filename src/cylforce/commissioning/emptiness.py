"""Is the machine in a recording empty and its tool in the air? Checks for a load, for contact of the tool and for a
wrong piston area: each of them would change the torque along known columns (mechanics/README.md, sections 8, 9)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.commissioning.wiring import Suspicion, misfit
from cylforce.estimation.batch import Fit, best, least_squares
from cylforce.estimation.blocks import Factors, beside, chosen, of_all, residual_squares
from cylforce.estimation.model import Model
from cylforce.estimation.priors.prior import Prior
from cylforce.signals.estimate import Array
from cylforce.signals.units import STANDARD_GRAVITY

CORRELATED = 50.0  # consecutive samples that count as one independent sample; chosen: half a second at 100 Hz
CONTACT = 4.0  # standard errors: a block's upward force at the tool beyond them is contact; chosen
EXPLAINED = 0.5  # of a block's squared residuals, which the force at the tool must explain at least; chosen
DISTURBED = 0.2  # trust (see `Fit.trust`) below which something other than weight and friction may act; chosen
NOTABLE = 0.1  # times the rated payload's weight: smallest force at the tool that counts as such a disturbance; chosen
BLOCKS = 2  # blocks with contact or disturbance from which on a recording is refused: one may be an end stop; chosen
HEAVY = 3.0  # standard errors of a load; machines within their data sheet's tolerances stay below 2.5
# A piston area counts as wrong when it differs by more than the share WRONG_AREA and the fit improves by more than
# SURE_AREA (see `Explanation.gain`); chosen: neighbouring bore sizes differ by more. The bars of a bucket linkage,
# whose masses are not in the model, look like an area that is wrong by less.
WRONG_AREA, SURE_AREA = 0.065, 25.0
FITTING = 0.05  # of the torque, which may remain unexplained with the corrected area; chosen
LIGHTEST = 0.05  # times the rated payload's weight: a smaller force at the tool is not counted as contact; chosen
AREA = 0.3  # prior standard error of a piston area's relative error; chosen


class Contact(NamedTuple):
    """Per block (B,): the upward `force` [N] at the tool that explains its residual best; whether this force is
    `certain`; whether the block is `disturbed` by anything else. `gain`: the improvement of the fit in those blocks
    that are certain (see `Explanation.gain`)."""

    force: Array
    certain: NDArray[np.bool_]
    disturbed: NDArray[np.bool_]
    gain: float


class Explanation(NamedTuple):
    """A possible cause for a recording that does not fit the empty machine of the data sheet: its estimated `value`;
    `gain`: decrease of the sum of squares with it, in variances of independent samples; `left`: share of the torque
    that remains unexplained (`wiring.misfit`)."""

    value: float
    gain: float
    left: float


class CarriedWeight(NamedTuple):
    """A load as a possible cause: its mass `value` [kg] with standard error [kg], `gain` and `left` as in
    `Explanation`."""

    value: float
    standard_error: float
    gain: float
    left: float

    @property
    def is_there(self) -> bool:
        """Whether the load is larger than HEAVY standard errors."""
        return self.value > HEAVY * self.standard_error


def not_empty(model: Model, whole: Factors, noise: Array, fit: Fit) -> Suspicion | None:
    """What to do when the recording shows a load, contact of the tool or a wrong piston area; else None. `whole`:
    factors with the tool's columns last; `noise` (R,) [N m] and `fit`: of the model's columns alone."""
    data = chosen(whole, list(range(len(model.parameters))))
    load, areas = hanging(model, data, noise, fit), area_errors(model, data, noise, fit)
    row = int(np.argmax([area.gain for area in areas]))
    contacts = contact(model, whole, noise, fit)
    wrong = areas[row].gain > max(SURE_AREA, load.gain, contacts.gain) and abs(areas[row].value) > WRONG_AREA
    if wrong and areas[row].left < FITTING:
        return _wrong_bore(model, row, areas[row])
    if np.count_nonzero(contacts.certain | contacts.disturbed) >= BLOCKS:
        return Suspicion("contact", _in_contact(whole, contacts, model.filters.rate_hz))
    return Suspicion("load", _loaded(load)) if load.is_there else None


def _wrong_bore(model: Model, row: int, found: Explanation) -> Suspicion:
    name = " and ".join(model.machine.cylinders[c].name for c in model.acting[row])
    large, fitting = found.value > 0.0, (1.0 + found.value) ** -0.5
    return Suspicion(
        f"bore_mm of {name}",
        f"the forces of {name} are {100 * abs(found.value):.0f} % too {'large' if large else 'small'} for the masses "
        f"that the other cylinders feel: check bore_mm and rod_mm of {name} in the machine file (a bore "
        f"{100 * abs(1.0 - fitting):.1f} % {'smaller' if large else 'larger'} would fit) and its pressures' range",
    )


def _in_contact(whole: Factors, contacts: Contact, rate_hz: float) -> str:
    blocks = contacts.certain | contacts.disturbed
    seconds = float(np.sum(np.max(whole.samples, axis=1)[blocks])) / rate_hz
    size = 1e-3 * float(np.max(contacts.force[contacts.certain], initial=0.0))
    how = (
        f"pressed upwards on the tool with up to {size:.0f} kN" if size else "acted that is neither weight nor friction"
    )
    return (
        f"for about {seconds:.0f} s something {how}: keep the tool clear of ground and obstacles, load and drop "
        "nothing, and start again"
    )


def _loaded(load: CarriedWeight) -> str:
    return (
        f"the bucket is not empty: about {load.value:.0f} +- {load.standard_error:.0f} kg hang on the machine beyond "
        "its data sheet; empty and clean it and start again, or, if it is empty, correct masses and tolerances in the "
        "machine file"
    )


def contact(model: Model, whole: Factors, noise: Array, fit: Fit) -> Contact:
    """For each block of `whole` (the tool's columns last) the force at the tool (x forward, z up) that explains best
    what the `fit` of the other columns leaves. Its prior is zero with a standard error of four rated payloads' weight,
    which remains in directions that the block's postures do not show."""
    whole, size = of_all(whole), len(model.parameters)
    blocks, rows = whole.samples.shape
    error = np.where(np.sum(whole.samples, axis=0) > 0, np.maximum(fit.row_error, 1e-9), 1.0)
    scale = error[:, None] * np.sqrt(CORRELATED)
    unexplained = whole.triangle[..., -1] - whole.triangle[..., :size] @ fit.values
    levers = whole.triangle[..., model.tool][..., :2]
    left = (unexplained / scale).reshape(blocks, -1, 1)
    tool = (levers / scale[..., None]).reshape(blocks, -1, 2)
    largest = 4.0 * model.machine.rated_payload * STANDARD_GRAVITY
    spread = np.linalg.inv(np.swapaxes(tool, 1, 2) @ tool + np.eye(2) / largest**2)
    force = spread @ (np.swapaxes(tool, 1, 2) @ left)
    squares = (np.sum(e.reshape(blocks, rows, -1) ** 2, axis=-1) for e in (left, left - tool @ force))
    before, after = squares
    up, lightest = force[:, 1, 0], LIGHTEST * model.machine.rated_payload * STANDARD_GRAVITY
    explained = np.sum(after, axis=1) < (1.0 - EXPLAINED) * np.sum(before, axis=1)
    certain = (up > np.maximum(CONTACT * np.sqrt(spread[:, 1, 1]), lightest)) & explained
    gain = (before - after)[certain] * (fit.trust[certain] * error / noise) ** 2
    there = np.sqrt(np.sum(unexplained**2, axis=2) / np.maximum(np.sum(levers**2, axis=(2, 3)), 1e-9))
    notable = there > NOTABLE * model.machine.rated_payload * STANDARD_GRAVITY
    return Contact(up, certain, np.any((fit.trust < DISTURBED) & notable, axis=1), float(np.sum(gain)))


def left_by_force(model: Model, whole: Factors, error: Array, values: Array) -> Array:
    """Squared residuals (B, R) [N^2 m^2] of parameters `values` (P,) when in each block of `whole` (the tool's columns
    last) the force at the tool is added that fits best; `error` (R,) [N m]: the rows' standard errors."""
    unexplained = whole.triangle[..., -1] - whole.triangle[..., : len(values)] @ values
    levers = whole.triangle[..., model.tool][..., :2]
    scale = error[:, None]
    squares = np.empty(unexplained.shape[:2])
    for k, (left, lever) in enumerate(zip(unexplained, levers, strict=True)):
        tool = (lever / scale[..., None]).reshape(-1, 2)
        force = np.linalg.lstsq(tool, (left / scale).ravel(), rcond=None)[0]
        squares[k] = np.sum((left - lever @ force) ** 2, axis=-1)
    return squares


def hanging(model: Model, data: Factors, noise: Array, fit: Fit) -> CarriedWeight:
    """The load that best explains the difference between the recording and the data sheet with its tolerances; its
    centre may be anywhere within the payload's reach."""
    wider, prior = with_load(model, data)
    found, k = least_squares(wider, noise, prior), len(fit.values)
    weight = fit.trust / (noise * np.sqrt(CORRELATED))
    gain = best(data, weight, model.prior)[1] - best(wider, weight, prior)[1]
    left = misfit(data, found.row_error)
    return CarriedWeight(float(found.values[k]), float(np.sqrt(found.covariance[k, k])), gain, left)


def with_load(model: Model, data: Factors) -> tuple[Factors, Prior]:
    """The factors and the prior with four more parameters: mass, two moments and inertia of a load."""
    rated, moment = model.machine.rated_payload, model.machine.rated_payload * model.machine.payload_reach
    spread = np.array([2.0 * rated, moment, moment, moment * model.machine.payload_reach])
    columns = np.broadcast_to(model.load, (data.samples.shape[1], *model.load.shape))
    return beside(data, columns), with_more(model.prior, spread)


def area_errors(model: Model, data: Factors, noise: Array, fit: Fit) -> list[Explanation]:
    """Per measured torque: by what share it is larger than the torque that follows from the masses which the other
    rows measure. By that share the true piston area is smaller than in the machine file."""
    weight, prior = fit.trust / (noise * np.sqrt(CORRELATED)), with_more(model.prior, np.array([AREA]))
    alone, found = best(data, weight, model.prior)[1], []
    for r in range(data.samples.shape[1]):
        columns = np.zeros((data.samples.shape[1], len(fit.values), 1))
        columns[r, :, 0] = fit.values
        wider = beside(data, columns)
        values, squares = best(wider, weight, prior)
        left = np.sqrt(np.sum(residual_squares(wider, values), axis=0) / np.maximum(np.sum(data.samples, axis=0), 1.0))
        found.append(Explanation(float(values[-1]), alone - squares, misfit(data, left)))
    return found


def with_more(prior: Prior, spread: Array) -> Prior:
    """The prior with M more parameters of mean zero and standard error `spread` (M,)."""
    size = len(spread)
    covariance = np.zeros((len(prior.mean) + size,) * 2)
    covariance[:-size, :-size], covariance[-size:, -size:] = prior.covariance, np.diag(spread**2)
    return Prior(np.append(prior.mean, np.zeros(size)), covariance)
