"""The page: figures and findings in one file of HTML that loads nothing."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from markupsafe import Markup

from cylforce.commissioning.coverage import NEEDED_S
from cylforce.commissioning.expectation import Expected
from cylforce.commissioning.identification import Identification
from cylforce.programs.reports import fits, maps
from cylforce.programs.reports.advice import middle
from cylforce.programs.reports.evidence import Drawn
from cylforce.programs.reports.findings import Findings
from cylforce.programs.reports.template import Wanted, drawn, rendered


def page(found: Identification, shown: Drawn, concluded: Findings, origin: Mapping[str, Any]) -> str:
    """Return the HTML.

    origin: provenance in identified.toml, its own name `output` and `output_sha256`
    """
    machine = found.model.machine
    return rendered(
        "page.html.j2",
        machine=machine.name,
        found=found,
        concluded=concluded,
        duration=shown.duration,
        rated=machine.rated_payload,
        needed=NEEDED_S,
        median=_median(concluded.expected),
        before=_median(concluded.sheet),
        scale=_scale(found),
        figures=_figures(found, shown, concluded),
        origin=origin,
        hashed=list(zip(origin["recordings"], origin["recording_sha256"], strict=True)),
        output=origin["output"],
        output_sha256=origin["output_sha256"],
    )


def _median(expected: Expected) -> str:
    typical = middle(expected)
    return f"{typical:.{0 if typical >= 100.0 else 1}f} kg" if np.isfinite(typical) else "no weight at all"


def _scale(found: Identification) -> str:
    tares = found.tares
    if not found.scale_measured:
        error, all_alike = (f"± {100.0 * e:.1f} %" for e in (tares.scale_error, tares.common_error))
        return (
            f"It contains the error of the data sheet's scale (bores, pins), {error}: no known weight was lifted. "
            f"Reported weights contain also what the data sheet's masses allow of a common scale of all pressures, "
            f"{all_alike}."
        )
    return f"It contains the error of the scale from a known weight, {tares.scale:.4f} ± {tares.scale_error:.4f}."


def _figures(found: Identification, shown: Drawn, concluded: Findings) -> dict[str, Markup]:
    machine = found.model.machine
    wanted: Wanted = {
        "torques": (lambda: fits.torques(found, shown), "measured and predicted torque of every joint"),
        "residuals": (lambda: fits.residuals(found, shown), "friction and residual over the speed of every cylinder"),
        "covered": (lambda: maps.covered(machine, shown), "seconds of motion in every part of every joint's range"),
        "weighing": (lambda: maps.weighing(machine, concluded), "standard error of a weight over the working range"),
        "parameters": (lambda: maps.parameters(concluded), "parameters with error bars against the data sheet"),
        "laws": (lambda: fits.laws(found), "error of the friction laws tried, in postures left out of the fit"),
    }
    return drawn(wanted)
