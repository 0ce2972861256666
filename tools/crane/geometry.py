"""The HMF 2020-K4 loader crane: dimensions and masses from `model_parameters.json` and
`stroke_to_angle_poly.json`.

Two links, boom and jib, each driven through a dogbone. Nothing of the crane is in this program: every
dimension comes from the folder. Bodies beside the two booms are lumped so: a rod between two pins (a link of
a dogbone, a cylinder at half stroke) becomes two point masses at its ends, with its mass and its centre kept;
a mass at the pin that two rods share counts at the outer rod's other end, on the driven link; what then sits
on the driving body counts there; the winch sits on the jib. The mistake of that, and of the CAD model itself,
is what the tolerance is for."""

import json
from collections.abc import Mapping
from math import pi
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cylforce.mechanics.linkages import FourBar
from cylforce.mechanics.machine import Cylinder, Link, Machine

from .expressions import Expressions

PARAMETERS, CURVES = "model_parameters.json", "stroke_to_angle_poly.json"
SLACK = 0.01  # m: a stroke measured just beyond the end of the cylinder still has an angle
SCAN = 20001
TURN = (-4.0, 2.0)  # rad: one turn that is not cut where the jib is folded


class Lump(NamedTuple):
    """A mass [kg] at a place [m] with an inertia [kg m^2] about it."""

    mass: float
    at: complex
    inertia: float = 0.0


class Crane(NamedTuple):
    """What the machine file says: linkages, bores and rods [mm], lengths [m], angles [rad], lumps of both
    links."""

    length: float
    tool: complex
    linkages: tuple[FourBar, FourBar]
    bores: tuple[float, float]
    rods: tuple[float, float]
    retracted: tuple[float, float]
    strokes: tuple[float, float]
    angles: tuple[tuple[float, float], tuple[float, float]]
    lumps: tuple[list[Lump], list[Lump]]


def crane(folder: Path) -> Crane:
    """The crane of the data's folder. The chain's link 1 runs from pin to pin, so the boom's frame is turned
    by the angle of the jib pin in it."""
    p = Expressions(json.loads((folder / PARAMETERS).read_text()))
    curves = json.loads((folder / CURVES).read_text())
    tip = place(p, "C")
    turn = np.conj(tip) / abs(tip)
    linkages = dogbones(p, turn)
    strokes = (p["stroke_MainC"], p["stroke_JibC"])
    retracted = retracted_lengths(linkages, curves, strokes, abs(tip), tip)
    draft = machine(linkages, abs(tip))
    return Crane(
        length=abs(tip),
        tool=place(p, "TP"),
        linkages=linkages,
        bores=(p["D_piston_MainC"], p["D_piston_JibC"]),
        rods=(p["D_rod_MainC"], p["D_rod_JibC"]),
        retracted=retracted,
        strokes=strokes,
        angles=(
            angle_range(draft, 0, retracted[0], strokes[0]),
            angle_range(draft, 1, retracted[1], strokes[1]),
        ),
        lumps=lumps(p, turn, retracted, strokes),
    )


def place(p: Expressions, pin: str) -> complex:
    """A pin in its part's own frame."""
    return complex(p[f"eta_{pin}"], p[f"zeta_{pin}"])


def dogbones(p: Expressions, turn: complex) -> tuple[FourBar, FourBar]:
    """Main and jib; the chassis has its origin in the boom pin."""
    pin = place(p, "B")
    main = FourBar(
        (0, place(p, "J") - pin),
        (0, place(p, "D") - pin),
        (1, place(p, "F") * turn),
        p["l_DE"],
        p["l_FE"],
        -1,
    )
    jib = FourBar((1, place(p, "K") * turn), (1, place(p, "G") * turn), (2, place(p, "I")), p["l_GH"], p["l_IH"], -1)
    return main, jib


def machine(linkages: tuple[FourBar, FourBar], length: float) -> Machine:
    """Just enough of a Machine to ask for cylinder lengths."""
    link = Link("link", length, 1.0, 0.0, 0.0, 1.0, -pi, pi, 0.0, 0.0, 0.0)
    cylinders = tuple(Cylinder(f"{k}", linkage, 1.0, 1.0, 0.0, 9.0) for k, linkage in enumerate(linkages))
    return Machine("draft", (link, link), cylinders, (), 1.0, 1.0, 1.0, 0.0)


def chain_angles(curves: Mapping[str, list[float]], k: int, stroke: np.ndarray, tip: complex) -> np.ndarray:
    """Joint angles (T, 2) of the chain along the authors' curve of joint k; the other joint at 0."""
    theta = np.zeros((len(stroke), 2))
    name = ("p_m_stroke_to_angle", "p_k_stroke_to_angle")[k]
    sign = (1.0, -1.0)[k]  # the boom's chain angle is larger by the angle of the jib pin, the jib's smaller
    theta[:, k] = np.polyval(curves[name], stroke) + sign * np.angle(tip)
    return theta


def retracted_lengths(
    linkages: tuple[FourBar, FourBar],
    curves: Mapping[str, list[float]],
    strokes: tuple[float, float],
    length: float,
    tip: complex,
) -> tuple[float, float]:
    """Length of each cylinder at stroke 0, which no parameter gives: what the authors' curves imply on
    average."""
    draft, found = machine(linkages, length), []
    for k in (0, 1):
        stroke = np.linspace(0.1, 0.9, 161) * strokes[k]
        known = draft.geometry(chain_angles(curves, k, stroke, tip)).length[:, k]
        found.append(float(np.median(known - stroke)))
    return found[0], found[1]


def angle_range(draft: Machine, k: int, retracted: float, stroke: float) -> tuple[float, float]:
    """The joint's range: where the linkage closes, moves one way, and covers the stroke and a little more."""
    theta = np.zeros((SCAN, 2))
    theta[:, k] = np.linspace(*TURN, SCAN)
    with np.errstate(invalid="ignore"):
        length = draft.geometry(theta).length[:, k]
        inside = (length > retracted - SLACK) & (length < retracted + stroke + SLACK) & (np.gradient(length) > 0)
    runs = np.split(np.arange(SCAN), np.flatnonzero(np.diff(inside)) + 1)
    longest = max((run for run in runs if inside[run[0]]), key=lambda run: np.ptp(length[run]))
    return float(theta[longest[0], k]), float(theta[longest[-1], k])


def lumps(
    p: Expressions, turn: complex, retracted: tuple[float, float], strokes: tuple[float, float]
) -> tuple[list[Lump], list[Lump]]:
    """Everything that counts as boom, everything that counts as jib, in the frames of the chain."""
    main, jib = (
        cylinder_ends(p, name, r + s / 2) for name, r, s in zip(("MainC", "JibC"), retracted, strokes, strict=True)
    )
    de, fe = rod_ends(p, "D2E", p["l_DE"]), rod_ends(p, "E2F", p["l_FE"])
    gh, ih = rod_ends(p, "G2H", p["l_GH"]), rod_ends(p, "H2I", p["l_IH"])
    boom = [
        body(p, "MainBoom", turn),
        Lump(main[1] + de[1] + sum(fe), place(p, "F") * turn),
        Lump(gh[0], place(p, "G") * turn),
        Lump(jib[0], place(p, "K") * turn),
    ]
    winch = Lump(p["Winch_mass"], place(p, "W"), p.several("Winch_MOI")[2])
    return boom, [body(p, "JibBoom", 1.0), Lump(jib[1] + gh[1] + sum(ih), place(p, "I")), winch]


def body(p: Expressions, name: str, turn: complex) -> Lump:
    """A boom, from its CAD part's frame."""
    along, across, _ = p.several(f"{name}_COM")
    return Lump(p[f"{name}_mass"], complex(along, across) * turn, p.several(f"{name}_MOI")[2])


def rod_ends(p: Expressions, name: str, length: float) -> tuple[float, float]:
    """Point masses at the first and the second named pin."""
    share = p.several(f"{name}_COM")[0] / length
    return p[f"{name}_mass"] * (1 - share), p[f"{name}_mass"] * share


def cylinder_ends(p: Expressions, name: str, length: float) -> tuple[float, float]:
    """Point masses at foot and eye; the barrel's centre is measured from the foot, the rod's from the eye."""
    barrel, rod = p[f"{name}_bottom_mass"], p[f"{name}_rod_mass"]
    far = (barrel * p.several(f"{name}_bottom_COM")[2] + rod * (length + p.several(f"{name}_rod_COM")[2])) / length
    return barrel + rod - far, far


def total(parts: list[Lump]) -> Lump:
    """Mass, centre, inertia about the centre."""
    mass = sum(part.mass for part in parts)
    centre = sum(part.mass * part.at for part in parts) / mass
    return Lump(mass, centre, sum(part.inertia + part.mass * abs(part.at - centre) ** 2 for part in parts))
