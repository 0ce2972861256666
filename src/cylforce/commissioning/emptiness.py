"""Check whether the machine in a recording is empty and its tool in the air.

A load, contact of the tool and a wrong piston area each change the torque along known columns (mechanics/README.md,
sections 8, 9).
"""

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
CONTACT = 4.0  # upward force at the tool that is contact, in its standard errors; chosen
EXPLAINED = 0.5  # least share of a block's squared residuals that the force at the tool must explain; chosen
DISTURBED = 0.2  # trust (see `Fit.trust`) below which something other than weight and friction may act; chosen
NOTABLE = 0.1  # smallest force at the tool that counts as such a disturbance, times the rated weight; chosen
BLOCKS = 2  # blocks with contact or disturbance from which on a recording is refused: one may be an end stop; chosen
HEAVY = 3.0  # significant load, in its standard errors; machines within their data sheet's tolerances stay below 2.5
# A piston area counts as wrong when it differs by more than the share WRONG_AREA and the fit improves by more than
# SURE_AREA (see `Explanation.gain`); chosen: neighbouring bore sizes differ by more. The bars of a bucket linkage,
# whose masses are not in the model, look like an area that is wrong by less.
WRONG_AREA, SURE_AREA = 0.065, 25.0
FITTING = 0.05  # largest unexplained share of the torque with the corrected area; chosen
LIGHTEST = 0.05  # smallest force at the tool that counts as contact, times the rated payload's weight; chosen
AREA = 0.3  # prior standard error of a piston area's relative error; chosen


class Contact(NamedTuple):
    """Contact of the tool, per block (B,).

    force: (B,) upward part of the force on the tool that explains the block's residual best [N]
    certain: (B,) whether the tool is pressed upwards: this part is significant, and the force explains the residual
    disturbed: (B,) whether something other than weight and friction acts: the fit trusts the block little (DISTURBED),
        and its residual is not small (NOTABLE)
    gain: improvement of the fit in the blocks that are `certain` (see `Explanation.gain`)
    """

    force: Array
    certain: NDArray[np.bool_]
    disturbed: NDArray[np.bool_]
    gain: float


class Explanation(NamedTuple):
    """A possible cause for a recording that does not fit the empty machine of the data sheet.

    value: its estimated size; of a piston area the relative excess of the measured force, see `area_errors`
    gain: decrease of the sum of squares with it, in variances of independent samples
    unexplained: share of the torque that remains unexplained (`wiring.misfit`)
    """

    value: float
    gain: float
    unexplained: float


class CarriedWeight(NamedTuple):
    """A load as a possible cause for a recording that does not fit the empty machine.

    value: its mass [kg]
    standard_error: of the mass [kg]
    gain: decrease of the sum of squares with it, in variances of independent samples
    unexplained: share of the torque that remains unexplained (`wiring.misfit`)
    """

    value: float
    standard_error: float
    gain: float
    unexplained: float

    @property
    def is_significant(self) -> bool:
        """Return whether the load is larger than HEAVY standard errors."""
        return self.value > HEAVY * self.standard_error


def load_or_contact(model: Model, whole: Factors, noise: Array, fit: Fit) -> Suspicion | None:
    """Return the suspicion of a load, of contact of the tool or of a wrong piston area; None when the recording shows
    none.

    A piston area comes first, where it explains the recording better than the other two. Contact comes next, then a
    load.

    whole: factors with the tool's columns (`Model.tool`) after those of the P parameters
    noise: (R,) rms residual of each torque fitted alone [N m]
    fit: fit of the P parameters alone
    """
    data = chosen(whole, list(range(len(model.parameters))))
    load, areas = carried_weight(model, data, noise, fit), area_errors(model, data, noise, fit)
    row = int(np.argmax([area.gain for area in areas]))
    contacts = contact(model, whole, noise, fit)
    wrong = areas[row].gain > max(SURE_AREA, load.gain, contacts.gain) and abs(areas[row].value) > WRONG_AREA
    if wrong and areas[row].unexplained < FITTING:
        return _wrong_bore(model, row, areas[row])
    if np.count_nonzero(contacts.certain | contacts.disturbed) >= BLOCKS:
        return Suspicion("contact", _in_contact(whole, contacts, model.filters.rate_hz))
    return Suspicion("load", _loaded(load)) if load.is_significant else None


def _wrong_bore(model: Model, row: int, area: Explanation) -> Suspicion:
    """Return the suspicion that the cylinders that act on a measured joint have another bore.

    row: number of the joint's torque among the R measured ones
    area: by which share this torque is too large (`area_errors`)
    """
    name = " and ".join(model.machine.cylinders[c].name for c in model.acting[row])
    large, fitting = area.value > 0.0, (1.0 + area.value) ** -0.5
    return Suspicion(
        f"bore_mm of {name}",
        f"the forces of {name} are {100 * abs(area.value):.0f} % too {'large' if large else 'small'} for the masses "
        f"that the other cylinders carry: check bore_mm and rod_mm of {name} in the machine file (a bore "
        f"{100 * abs(1.0 - fitting):.1f} % {'smaller' if large else 'larger'} would fit) and its pressures' range",
    )


def _in_contact(whole: Factors, contacts: Contact, rate_hz: float) -> str:
    """Return the sentence about contact, with its duration [s] and largest upward force [kN].

    whole: factors of the blocks of the recording
    rate_hz: samples a second
    """
    blocks = contacts.certain | contacts.disturbed
    seconds = float(np.sum(np.max(whole.samples, axis=1)[blocks])) / rate_hz
    size = 1e-3 * float(np.max(contacts.force[contacts.certain], initial=0.0))
    how = (
        f"pressed upwards on the tool with up to {size:.1f} kN" if size else "acted that is neither weight nor friction"
    )
    return (
        f"for about {seconds:.0f} s something {how}: keep the tool clear of ground and obstacles, load and drop "
        "nothing, and start again"
    )


def _loaded(load: CarriedWeight) -> str:
    """Return the sentence about a load."""
    return (
        f"the bucket is not empty: about {load.value:.0f} +- {load.standard_error:.0f} kg hang on the machine beyond "
        "its data sheet; empty and clean it and start again, or, if it is empty, correct masses and tolerances in the "
        "machine file"
    )


def contact(model: Model, whole: Factors, noise: Array, fit: Fit) -> Contact:
    """Return for each block the upward part of the force on the tool that best explains the residual of a fit.

    The force (x forward, z up) has a prior of zero with a standard error of four rated payloads' weight. That error
    remains in directions that the block's postures do not show.

    whole: factors with the tool's columns (`Model.tool`) after those of the P parameters
    noise: (R,) rms residual of each torque fitted alone [N m]
    fit: fit of the P parameters alone
    """
    whole, size = of_all(whole), len(model.parameters)
    blocks, rows = whole.samples.shape
    error = np.where(np.sum(whole.samples, axis=0) > 0, np.maximum(fit.row_error, 1e-9), 1.0)
    scale = error[:, None] * np.sqrt(CORRELATED)
    unexplained = whole.triangle[..., -1] - whole.triangle[..., :size] @ fit.values
    levers = whole.triangle[..., model.tool][..., :2]
    residual = (unexplained / scale).reshape(blocks, -1, 1)
    tool = (levers / scale[..., None]).reshape(blocks, -1, 2)
    largest = 4.0 * model.machine.rated_payload * STANDARD_GRAVITY
    spread = np.linalg.inv(np.swapaxes(tool, 1, 2) @ tool + np.eye(2) / largest**2)
    force = spread @ (np.swapaxes(tool, 1, 2) @ residual)  # f = (A'A + P0^-1)^-1 A' r
    before, after = (np.sum(e.reshape(blocks, rows, -1) ** 2, axis=-1) for e in (residual, residual - tool @ force))
    up, lightest = force[:, 1, 0], LIGHTEST * model.machine.rated_payload * STANDARD_GRAVITY
    explained = np.sum(after, axis=1) < (1.0 - EXPLAINED) * np.sum(before, axis=1)
    certain = (up > np.maximum(CONTACT * np.sqrt(spread[:, 1, 1]), lightest)) & explained
    gain = (before - after)[certain] * (fit.trust[certain] * error / noise) ** 2
    # size of a force at the tool that would make the residual: rms torque over rms lever
    size = np.sqrt(np.sum(unexplained**2, axis=2) / np.maximum(np.sum(levers**2, axis=(2, 3)), 1e-9))
    notable = size > NOTABLE * model.machine.rated_payload * STANDARD_GRAVITY
    return Contact(
        force=up,
        certain=certain,
        disturbed=np.any((fit.trust < DISTURBED) & notable, axis=1),
        gain=float(np.sum(gain)),
    )


def residual_with_tip_force(model: Model, whole: Factors, error: Array, values: Array) -> Array:
    """Return the sums of squared residuals (B, R) [N^2 m^2] with the best force at the tool in each block.

    whole: factors with the tool's columns (`Model.tool`) after those of the P parameters
    error: (R,) standard errors of the rows [N m]
    values: (P,) parameters
    """
    unexplained = whole.triangle[..., -1] - whole.triangle[..., : len(values)] @ values
    levers = whole.triangle[..., model.tool][..., :2]
    scale = error[:, None]
    squares = np.empty(unexplained.shape[:2])
    for k, (residual, lever) in enumerate(zip(unexplained, levers, strict=True)):
        tool = (lever / scale[..., None]).reshape(-1, 2)
        force = np.linalg.lstsq(tool, (residual / scale).ravel(), rcond=None)[0]
        squares[k] = np.sum((residual - lever @ force) ** 2, axis=-1)
    return squares


def carried_weight(model: Model, data: Factors, noise: Array, fit: Fit) -> CarriedWeight:
    """Return the load that best explains the difference between the recording and the data sheet with its tolerances.

    Its centre may be anywhere within the payload's reach.

    data: factors of the model's columns
    noise: (R,) rms residual of each torque fitted alone [N m]
    fit: fit of the model's columns
    """
    wider, prior = with_load(model, data)
    loaded, k = least_squares(wider, noise, prior), len(fit.values)  # k: number of the mass among the parameters
    weight = fit.trust / (noise * np.sqrt(CORRELATED))
    return CarriedWeight(
        value=float(loaded.values[k]),
        standard_error=float(np.sqrt(loaded.covariance[k, k])),
        gain=best(data, weight, model.prior)[1] - best(wider, weight, prior)[1],
        unexplained=misfit(data, loaded.row_error),
    )


def with_load(model: Model, data: Factors) -> tuple[Factors, Prior]:
    """Return factors and prior with four more parameters, last: mass, two first moments and inertia of a load.

    They are about the last pin [kg, kg m, kg m, kg m^2], with prior means of zero.

    data: factors of the model's columns
    """
    rated, moment = model.machine.rated_payload, model.machine.rated_payload * model.machine.payload_reach
    spread = np.array([2.0 * rated, moment, moment, moment * model.machine.payload_reach])
    columns = np.broadcast_to(model.load, (data.samples.shape[1], *model.load.shape))
    return beside(data, columns), with_free_parameters(model.prior, spread)


def area_errors(model: Model, data: Factors, noise: Array, fit: Fit) -> list[Explanation]:
    """Return for each of the R measured torques the share by which it exceeds what masses measured by the others give.

    Where the share is positive, the true piston area is smaller than in the machine file, by about that share. Each
    share is fitted by itself, with all masses.

    data: factors of the model's columns
    noise: (R,) rms residual of each torque fitted alone [N m]
    fit: fit of the model's columns
    """
    weight, prior = fit.trust / (noise * np.sqrt(CORRELATED)), with_free_parameters(model.prior, np.array([AREA]))
    without, errors = best(data, weight, model.prior)[1], []
    for r in range(data.samples.shape[1]):
        columns = np.zeros((data.samples.shape[1], len(fit.values), 1))
        columns[r, :, 0] = fit.values
        wider = beside(data, columns)
        values, squares = best(wider, weight, prior)
        samples = np.maximum(np.sum(data.samples, axis=0), 1.0)
        row_error = np.sqrt(np.sum(residual_squares(wider, values), axis=0) / samples)
        errors.append(Explanation(value=float(values[-1]), gain=without - squares, unexplained=misfit(data, row_error)))
    return errors


def with_free_parameters(prior: Prior, spread: Array) -> Prior:
    """Return the prior with M more parameters, last, of mean zero and standard error `spread` (M,).

    They are independent of the others and of each other.
    """
    size = len(spread)
    covariance = np.zeros((len(prior.mean) + size,) * 2)
    covariance[:-size, :-size], covariance[-size:, -size:] = prior.covariance, np.diag(spread**2)
    return Prior(np.append(prior.mean, np.zeros(size)), covariance)
