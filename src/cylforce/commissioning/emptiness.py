"""Is the machine in a recording empty and free? Signatures of a load, of a tool that touches something and of a wrong
piston area in the factors of a recording: what each would change lies along known columns
(mechanics/README.md, sections 8 and 9)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.commissioning.wiring import misfit
from cylforce.estimation.batch import Fit, Prior, best, least_squares
from cylforce.estimation.blocks import Factors, beside, chosen, of_all, residual_squares
from cylforce.estimation.model import Model
from cylforce.signals.estimate import Array
from cylforce.signals.units import STANDARD_GRAVITY

CORRELATED = 50.0  # samples of a block that say the same, at most: half a second
TOUCHED = 4.0  # standard errors of a block's tip force from which on something touched the tool
EXPLAINED = 0.5  # of the block's squares that the tip force must explain
SPOILT = 0.2  # trust in a block below which something else than weight and friction may have acted
NOTABLE = 0.1  # of the rated payload's weight: what spoils a block must be as large, seen as a force at the tool
BLOCKS = 2  # touched from which on a recording is refused: one may be a stone, a door, a stop
HEAVY = 3.0  # standard errors of a load; machines within their data sheet's tolerances stay below 2.5
WRONG_AREA, SURE_AREA = 0.065, 25.0  # share and gain from which a piston area is wrong: sizes differ by more; the bars
# of a bucket linkage, whose masses the model does not have, look like an area that is wrong by less, and less surely
FITTING = 0.05  # of the torque that may be left unexplained with the true area
LIGHTEST = 0.05  # of the rated payload's weight: a smaller force is nobody's
AREA = 0.3  # a piston area may be wrong by such a share


class Contact(NamedTuple):
    """Per block (B,): the upward `force` [N] at the tool that explains its residual best, whether it is `certain` that
    it pressed upwards, whether the block is `spoilt` by whatever; the `gain` of those that are certain."""

    force: Array
    certain: NDArray[np.bool_]
    spoilt: NDArray[np.bool_]
    gain: float


class Explanation(NamedTuple):
    """What could explain a recording that is not the data sheet's empty machine: the `value` of that cause, its `gain`:
    by how much the sum of squares falls with it, in variances of independent samples, and the share of the torque that
    is then `left` (`misfit`)."""

    value: float
    gain: float
    left: float


class CarriedWeight(NamedTuple):
    """A load [kg], its standard error, its gain, and the share of the torque that is then `left`."""

    value: float
    standard_error: float
    gain: float
    left: float

    @property
    def is_there(self) -> bool:
        """Beyond doubt."""
        return self.value > HEAVY * self.standard_error


def not_empty(model: Model, whole: Factors, noise: Array, fit: Fit) -> str | None:
    """A sentence that says what to do when the recording is not of the empty and free machine of the data sheet.
    `whole`: its factors, the tool's columns last; `noise` (R,), `fit`: of the model's columns."""
    data = chosen(whole, list(range(len(model.parameters))))
    load, areas = hanging(model, data, noise, fit), area_errors(model, data, noise, fit)
    row = int(np.argmax([area.gain for area in areas]))
    touched = contact(model, whole, noise, fit)
    wrong = areas[row].gain > max(SURE_AREA, load.gain, touched.gain) and abs(areas[row].value) > WRONG_AREA
    if wrong and areas[row].left < FITTING:
        return _wrong_bore(model, row, areas[row])
    if np.count_nonzero(touched.certain | touched.spoilt) >= BLOCKS:
        return _touching(whole, touched, model.filters.rate_hz)
    return _loaded(load) if load.is_there else None


def _wrong_bore(model: Model, row: int, found: Explanation) -> str:
    name = " and ".join(model.machine.cylinders[c].name for c in model.acting[row])
    large, fitting = found.value > 0.0, (1.0 + found.value) ** -0.5
    return (
        f"the forces of {name} are {100 * abs(found.value):.0f} % too {'large' if large else 'small'} for the masses "
        f"that the other cylinders feel: check bore_mm and rod_mm of {name} in the machine file (a bore "
        f"{100 * abs(1.0 - fitting):.1f} % {'smaller' if large else 'larger'} would fit) and its pressures' range"
    )


def _touching(whole: Factors, touched: Contact, rate_hz: float) -> str:
    blocks = touched.certain | touched.spoilt
    seconds = float(np.sum(np.max(whole.samples, axis=1)[blocks])) / rate_hz
    size = 1e-3 * float(np.max(touched.force[touched.certain], initial=0.0))
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
    """The force at the tool (x forward, z up) that each block of `whole`, the tool's columns included, shows beyond the
    `fit` of its first columns. A force that no posture of the block shows stays as uncertain as it was."""
    whole, size = of_all(whole), len(model.parameters)
    blocks, rows = whole.samples.shape
    error = np.where(np.sum(whole.samples, axis=0) > 0, np.maximum(fit.row_error, 1e-9), 1.0)
    scale = error[:, None] * np.sqrt(CORRELATED)
    unexplained = whole.triangle[..., -1] - whole.triangle[..., :size] @ fit.values
    levers = whole.triangle[..., model.tool][..., :2]
    left = (unexplained / scale).reshape(blocks, -1, 1)
    tool = (levers / scale[..., None]).reshape(blocks, -1, 2)
    usual = 4.0 * model.machine.rated_payload * STANDARD_GRAVITY
    spread = np.linalg.inv(np.swapaxes(tool, 1, 2) @ tool + np.eye(2) / usual**2)
    force = spread @ (np.swapaxes(tool, 1, 2) @ left)
    squares = (np.sum(e.reshape(blocks, rows, -1) ** 2, axis=-1) for e in (left, left - tool @ force))
    before, after = squares
    up, lightest = force[:, 1, 0], LIGHTEST * model.machine.rated_payload * STANDARD_GRAVITY
    explained = np.sum(after, axis=1) < (1.0 - EXPLAINED) * np.sum(before, axis=1)
    certain = (up > np.maximum(TOUCHED * np.sqrt(spread[:, 1, 1]), lightest)) & explained
    gain = (before - after)[certain] * (fit.trust[certain] * error / noise) ** 2
    there = np.sqrt(np.sum(unexplained**2, axis=2) / np.maximum(np.sum(levers**2, axis=(2, 3)), 1e-9))
    notable = there > NOTABLE * model.machine.rated_payload * STANDARD_GRAVITY
    return Contact(up, certain, np.any((fit.trust < SPOILT) & notable, axis=1), float(np.sum(gain)))


def hanging(model: Model, data: Factors, noise: Array, fit: Fit) -> CarriedWeight:
    """The load that best explains what lies between the recording and the data sheet with its tolerances, wherever
    within the tool's reach its centre is."""
    rated, moment = model.machine.rated_payload, model.machine.rated_payload * model.machine.payload_reach
    spread = np.array([2.0 * rated, moment, moment, moment * model.machine.payload_reach])
    columns = np.broadcast_to(model.load, (data.samples.shape[1], *model.load.shape))
    wider, prior = beside(data, columns), _beside(model.prior, spread)
    found, k = least_squares(wider, noise, prior), len(fit.values)
    weight = fit.trust / (noise * np.sqrt(CORRELATED))
    gain = best(data, weight, model.prior)[1] - best(wider, weight, prior)[1]
    left = misfit(data, found.row_error)
    return CarriedWeight(float(found.values[k]), float(np.sqrt(found.covariance[k, k])), gain, left)


def area_errors(model: Model, data: Factors, noise: Array, fit: Fit) -> list[Explanation]:
    """Per row, by what share its torque is larger than the masses that the other rows feel would make it: so much
    smaller is its cylinder's piston area than the machine file says."""
    weight, prior = fit.trust / (noise * np.sqrt(CORRELATED)), _beside(model.prior, np.array([AREA]))
    alone, found = best(data, weight, model.prior)[1], []
    for r in range(data.samples.shape[1]):
        columns = np.zeros((data.samples.shape[1], len(fit.values), 1))
        columns[r, :, 0] = fit.values
        wider = beside(data, columns)
        values, squares = best(wider, weight, prior)
        left = np.sqrt(np.sum(residual_squares(wider, values), axis=0) / np.maximum(np.sum(data.samples, axis=0), 1.0))
        found.append(Explanation(float(values[-1]), alone - squares, misfit(data, left)))
    return found


def _beside(prior: Prior, spread: Array) -> Prior:
    """The prior of M more parameters too, zero but for `spread` (M,)."""
    size = len(spread)
    covariance = np.zeros((len(prior.mean) + size,) * 2)
    covariance[:-size, :-size], covariance[-size:, -size:] = prior.covariance, np.diag(spread**2)
    return Prior(np.append(prior.mean, np.zeros(size)), covariance)
