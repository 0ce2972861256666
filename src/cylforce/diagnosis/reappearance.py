"""How far an effect seems to be there where it is not: in parts of the clean recordings, told by the other parts.

What a model lacks goes with the posture and is alike in block after block, so that neither white noise nor the scatter
of blocks knows of it; it shows when a part of the machine's own reference plays the faulty recording."""

from dataclasses import replace

import numpy as np

from cylforce.diagnosis.evidence import Blocks, Evidence, Term

PARTS = 4
USUAL = 2.0  # inflation, as most columns have it on reference machines in order


def reappearance(blocks: Blocks, term: Term) -> float:
    """Mean square of the term's sizes in quarters of the clean recordings over what white noise would make of them, at
    least 1; 1 without enough clean blocks. An effect's standard errors are too small by the root of it."""
    count, columns = len(blocks.clean), tuple(dict.fromkeys(term.columns))
    if count < 2 * PARTS:
        return 1.0
    squares, part = [], np.arange(count) * PARTS // count
    for k in range(PARTS):
        own = slice(*np.searchsorted(part, [k, k + 1]))  # no copy: these are large
        played = replace(blocks, faulty=blocks.clean[own], faulty_rows=blocks.clean_rows[own])
        length = len(played.faulty)
        weight = np.concatenate([np.where(part == k, 0.0, 1.0), np.ones(length)])
        told = Evidence(played, weight=weight).of(Term(columns, np.ones((len(columns), length))), 1.0)
        squares.append(float(told.value @ np.linalg.solve(told.covariance, told.value)) / len(columns))
    return max(1.0, float(np.mean(squares)))


def usual(blocks: Blocks, term: Term) -> float:
    """The inflation that the term's own columns have where it is not: in one half of the clean blocks, told by the
    other; USUAL without enough of them. What goes slowly scatters more than white noise on a machine in order, too."""
    count, columns = len(blocks.clean), tuple(dict.fromkeys(term.columns))
    if count < 2 * PARTS:
        return USUAL
    half = np.arange(count) // 2 % 2 == 1
    played = replace(blocks, faulty=blocks.clean[half], faulty_rows=blocks.clean_rows[half])
    weight = np.concatenate([np.where(half, 0.0, 1.0), np.ones(int(np.sum(half)))])
    return Evidence(played, weight=weight).of(Term(columns, np.ones((len(columns), int(np.sum(half)))))).inflation
