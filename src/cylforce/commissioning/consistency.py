"""Physical consistency of tares: laws that every body and every friction obeys, and the nearest tares that obey them.

A planar body of mass m is physically possible exactly when J m >= X^2 + Z^2: the distance of its centre from the pin
cannot exceed its radius of gyration about the pin. The law also holds with the masses beyond a link lumped at its outer
pin.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cylforce.estimation.model import Model, Tares
from cylforce.estimation.priors.bars import balanced
from cylforce.signals.estimate import Array

MASS_BOUND = 3.0  # upper limit of a link's mass, in standard errors above the data sheet's mass; chosen
INSIDE = 1e-6  # scaled margin that is enforced, so that the law holds after rounding, too; chosen
SURE = 3.0  # standard errors below zero from which on a friction coefficient breaks its law; chosen
NEVER_NEGATIVE = (".coulomb", ".viscous", ".load_dependent", ".rocker")  # ends of names of such parameters


class Law(NamedTuple):
    """A physical law of the parameters.

    sentence: how it is broken
    margin: function of the parameters (P,) that must not be negative; about 1 for a typical machine
    """

    sentence: str
    margin: Callable[[Array], float]


def laws(model: Model) -> list[Law]:
    """Return the laws that the tares of any machine obey: J m >= X^2 + Z^2 of each link, then signs.

    No parameter whose name ends as in NEVER_NEGATIVE is negative. Bars that lie on both sides of their rocker's pin are
    excepted: their first moment may have either sign.
    """
    place = {p.name: k for k, p in enumerate(model.parameters)}
    heaviest = np.cumsum([k.mass + MASS_BOUND * k.mass_error for k in model.machine.links[::-1]])[::-1]
    bodies = [_body(link.name, place, float(m)) for link, m in zip(model.machine.links, heaviest, strict=True)]
    spread = np.sqrt(np.diag(model.prior.covariance))
    frictions = [
        _positive(p.name, k, float(spread[k]))
        for k, p in enumerate(model.parameters)
        if p.name.endswith(NEVER_NEGATIVE) and p.name not in balanced(model.machine)
    ]
    return [*bodies, *frictions]


def _body(name: str, place: dict[str, int], mass: float) -> Law:
    """Return the law J m >= X^2 + Z^2 of a link.

    name: name of the link
    place: number of each parameter, by its name
    mass: largest mass of the link and of all links beyond it [kg]
    """
    j, x, z = (place[f"{name}.{symbol}"] for symbol in ("J", "X", "Z"))

    def margin(values: Array) -> float:
        first = float(np.hypot(values[x], values[z]))
        return float(values[j] * mass - first**2) / (first**2 + 1.0)

    return Law(f"{name}: J is too small for its first moments (J m < X^2 + Z^2 with m = {mass:.0f} kg)", margin)


def _positive(name: str, k: int, scale: float) -> Law:
    """Return the law that parameter k is not negative.

    scale: standard error of the parameter in the data sheet, in the parameter's unit
    """
    why = "bars weigh something" if name.endswith(".rocker") else "friction cannot push"
    return Law(f"{name}: {why}", lambda values: float(values[k]) / scale)


def violations(model: Model, values: Array, error: Array | None = None) -> tuple[str, ...]:
    """Return one sentence for each law that parameters break.

    values: (P,) parameters of the empty machine, in the SI units of the model
    error: (P,) their standard errors; with them a friction coefficient, or the first moment of the bars of a four-bar
        linkage, breaks its law only when it is below zero by more than SURE standard errors
    """
    if error is not None:
        never_negative = np.array([p.name.endswith(NEVER_NEGATIVE) for p in model.parameters])
        values = np.where(never_negative & (values < 0.0), np.minimum(values + SURE * error, 0.0), values)
    return tuple(law.sentence for law in laws(model) if law.margin(values) < 0.0)


def consistent(model: Model, tares: Tares) -> Tares:
    """Return the nearest tares that break no law, in the metric of their covariance.

    Only the values change; the covariance remains that of the fit. Tares that break no law are returned unchanged.
    Raises ValueError when no consistent tares are found.
    """
    if not violations(model, tares.values):
        return tares
    from scipy import optimize

    scale = np.sqrt(np.diag(tares.covariance))
    root = np.linalg.cholesky(np.linalg.inv(tares.covariance / np.outer(scale, scale))).T

    def distance(shift: Array) -> float:
        """Return the squared distance from the fit; `shift` (P,) in standard errors."""
        return float(np.sum((root @ shift) ** 2))

    to_obey = laws(model)

    def margins(shift: Array) -> Array:
        """Return the margins of all laws; `shift` (P,) in standard errors."""
        return np.array([law.margin(tares.values + scale * shift) for law in to_obey])

    limit = optimize.NonlinearConstraint(margins, INSIDE, np.inf)
    optimum = optimize.minimize(distance, np.zeros_like(scale), method="SLSQP", constraints=limit)
    if not optimum.success:
        raise ValueError(
            f"no physically consistent tares were found near the fit: {optimum.message}; "
            "identify without --enforce, and check masses and lengths in the machine file"
        )
    return tares._replace(values=tares.values + scale * optimum.x)
