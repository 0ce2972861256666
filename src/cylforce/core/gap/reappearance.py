"""How far an effect seems to be there where it is not: in parts of the clean recordings, told by the other parts.

What a model lacks goes with the posture and is alike in block after block, so that neither white noise nor the scatter
of blocks knows of it; it shows when a part of the machine's own reference plays the faulty recording."""

import numpy as np

from cylforce.core.gap.evidence import Blocks, Evidence, Term

PARTS = 4


def reappearance(blocks: Blocks, term: Term) -> float:
    """Mean square of the term's sizes in quarters of the clean recordings over what white noise would make of them, at
    least 1; 1 without enough clean blocks. An effect's standard errors are too small by the root of it."""
    count, columns = len(blocks.clean), tuple(dict.fromkeys(term.columns))
    if count < 2 * PARTS:
        return 1.0
    squares = []
    part = np.arange(count) * PARTS // count
    for k in range(PARTS):
        own, rest = part == k, part != k
        played = Blocks(
            clean=blocks.clean[rest],
            faulty=blocks.clean[own],
            clean_rows=blocks.clean_rows[rest],
            faulty_rows=blocks.clean_rows[own],
            spread=blocks.spread,
            always=blocks.always,
            shared=blocks.shared,
        )
        told = Evidence(played).of(Term(columns, np.ones((len(columns), int(np.sum(own))))), 1.0)
        squares.append(float(told.value @ np.linalg.solve(told.covariance, told.value)) / len(columns))
    return max(1.0, float(np.mean(squares)))
