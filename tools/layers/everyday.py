"""How much machines in order differ from one recording to the next, effect by effect."""

from collections.abc import Sequence

import numpy as np

from cylforce.diagnosis.inference.discrepancy import Scatter, Sums
from cylforce.diagnosis.inference.hypotheses import Inference
from cylforce.diagnosis.inference.in_order import InOrder
from cylforce.diagnosis.numbers import USUALLY

LEARNT = 0.02, 1.0  # the least and the largest that is learnt: beyond the least plausible size it is a fault
FASTER, FURTHEST = 8.0, 0.7  # power of a step of expectation maximisation, its logarithm at most


def differences(machine: InOrder, case: Inference, noise: Scatter) -> dict[str, list[float]]:
    """Expected squares of the everyday differences in a recording of the machine in order under its noise, of the
    least plausible size, by name of the effect."""
    state, found = case.state(noise), dict[str, list[float]]()
    share = machine.usual**2 / (np.diag(case.covariance) + machine.usual**2)
    for p in machine.scene.forms:
        k = p.columns[0]
        # what is fitted is the reference's error and the everyday difference together
        pulled, variance = state.fitted[k] * share[k], machine.usual[k] ** 2
        known = state.covariance[k, k] * share[k] ** 2 + variance * (1.0 - share[k])
        found.setdefault(p.name, []).append(float((pulled**2 + known) * (machine.scene.spread[k] / p.low) ** 2))
    return found


def learnt(machines: Sequence[tuple[InOrder, Sums]], rounds: int = 40) -> dict[str, float]:
    """Everyday differences by name of the effect, of its least plausible size: empirical Bayes (expectation
    maximisation) over recordings of machines in order. Steps go further than expectation maximisation, which creeps
    where many places tell nothing, until they turn back."""
    found, power, last = dict[str, float](), dict[str, float](), dict[str, float]()
    noises = [m.asked(each).hypothesis((), m.noise).noise for m, each in machines]
    for _ in range(rounds):
        told = dict[str, list[float]]()
        for (machine, recording), noise in zip(machines, noises, strict=True):
            own = machine.with_everyday(found)
            for name, squares in differences(own, own.asked(recording), noise).items():
                told.setdefault(name, []).extend(squares)
        for name, squares in told.items():
            size = found.get(name, USUALLY)
            step = float(np.log(np.sqrt(np.mean(squares)) / size))
            turned = step * last.get(name, step) < 0.0
            power[name] = max(1.0, power.get(name, FASTER) * (0.5 if turned else 1.0))
            last[name] = step
            found[name] = float(np.clip(size * np.exp(np.clip(power[name] * step, -FURTHEST, FURTHEST)), *LEARNT))
    return found
