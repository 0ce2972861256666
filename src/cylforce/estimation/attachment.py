"""Tares of a machine with another tool, from those that were identified with its standard tool.

A tool b = (m, m x, m z, J about the last pin) adds L b to the parameters, with L of `Model.load`. The old tool b is
taken off, the new one b' put on: Phi' = Phi - L b + L b'. The old tool's first moments and inertia are part of Phi. Its
mass follows from them and from its data sheet."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.model import Model, Tares
from cylforce.estimation.priors.bars import represented
from cylforce.mechanics.machine import Link
from cylforce.signals.estimate import Array

FLOOR = 1e-6  # of a variance of a tool's values, relative to the value's square and absolute [SI]; chosen
# Relative standard error of the change of slewing's parameters by the other tool; chosen. `Model.prior` has errors that
# follow from each link's depth and tolerances instead (`priors/depth.py`).
SLEWING = 0.2


class Tool(NamedTuple):
    """Mass, first moments and moment of inertia of a tool, with its pin as origin.

    values:     (4,) m, m x, m z, J about the last pin [kg, kg m, kg m, kg m^2]
    covariance: (4, 4) of the values
    """

    values: Array
    covariance: Array


def tool_of(link: Link) -> Tool:
    """Return a link's data sheet as a tool (m, m x, m z, J about its inner pin), with its covariance.

    The tolerances of mass, centre and inertia are independent standard errors, propagated to first order. To the
    variance of each value, FLOOR times its square and FLOOR [SI] are added, so that the covariance can be inverted: a
    standard error of a thousandth of the value, and one of 0.001 kg, kg m or kg m^2.

    link: mass [kg]; centre of mass cx, cz [m] from its inner pin, along and across the link; inertia about this centre
          [kg m^2]
    """
    m, x, z = link.mass, link.cx, link.cz
    values = np.array([m, m * x, m * z, link.inertia + m * (x**2 + z**2)])
    gradient = np.array([[1.0, 0, 0, 0], [x, m, 0, 0], [z, 0, m, 0], [x**2 + z**2, 2 * m * x, 2 * m * z, 1.0]])
    errors = gradient * (link.mass_error, link.centre_error, link.centre_error, link.inertia_error)
    return Tool(values, errors @ errors.T + np.diag(FLOOR * values**2 + FLOOR))


def with_tool(tares: Tares, standard: Model, other: Model) -> Tares:
    """Return the tares of the machine with another tool: Phi' = Phi - L b + L b'.

    Phi are the parameters, L the change of the parameters per unit of a tool, b the old tool and b' the new one, each
    (m, m x, m z, J about the last pin). The old tool's first moments and inertia are those in Phi. Its mass is that of
    its data sheet, corrected by the difference of these moments from the data sheet's. The new tool is that of its data
    sheet. The covariance contains the tolerances of the new tool, and the old tool's mass as far as its moments do not
    determine it. The parameters of slewing change by the difference of the two data sheets, with a standard error of
    SLEWING of that change. All else, such as row errors and scale, remains that of the identified tares.

    tares:    identified with the standard tool
    standard: model of the machine with the standard tool, its last link
    other:    model of the machine with the other tool
    """
    old, new, put = tool_of(standard.machine.links[-1]), tool_of(other.machine.links[-1]), other.load
    # (3, P): from Phi to the tool's m x, m z, J, with the linkages' bars that a data sheet's link contains
    own = put[:, 1:].T @ represented(standard.machine, tares.names)
    heavier = np.linalg.solve(old.covariance[1:, 1:], old.covariance[1:, 0])  # C_bb^-1 C_bm
    unknown = old.covariance[0, 0] - heavier @ old.covariance[1:, 0]  # variance of the mass, given the moments
    mass = old.values[0] + heavier @ (own @ tares.values - old.values[1:])
    values = tares.values + put @ (new.values - np.append(mass, own @ tares.values))  # Phi + L (b' - b)
    common = np.eye(len(values)) - put @ np.vstack([heavier @ own, own])
    slewing, changed = _slewing_change(standard, other)
    values[slewing] += changed
    error = new.covariance + np.diag([unknown, 0.0, 0.0, 0.0])
    covariance = common @ tares.covariance @ common.T + put @ error @ put.T
    covariance[slewing, slewing] += (SLEWING * changed) ** 2
    return tares._replace(values=values, covariance=(covariance + covariance.T) / 2.0)


def _slewing_change(standard: Model, other: Model) -> tuple[NDArray[np.intp], Array]:
    """Return the numbers (n,) of the parameters of slewing, and by how much (n,) the other tool changes them [kg m^2].

    These parameters, D_excess and E of each link, are second moments that act only while the house slews. They are no
    part of a tool's (m, m x, m z, J), so that they change by the difference of the data sheets: other less standard.

    standard, other: models of the machine with either tool, with the same parameters in the same order
    """
    names = enumerate(p.name for p in other.parameters)
    slewing = np.array([k for k, name in names if name.endswith((".D_excess", ".E"))], dtype=np.intp)
    return slewing, (other.prior.mean - standard.prior.mean)[slewing]
