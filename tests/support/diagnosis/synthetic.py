"""Whitened rows of known parameters, effects, discrepancy and noise, and their likelihood: no machine is needed."""

import numpy as np

from cylforce.diagnosis.constants import POLYNOMIALS
from cylforce.diagnosis.likelihood import DECAY, Form, Likelihood, MachineKnowledge, ResidualNoise
from cylforce.diagnosis.statistics import Blocks, Gram, SharedNoise, polynomials
from cylforce.readings.constants import BLOCK_ROWS

BLOCKS, JOINTS, COLUMNS = 40, 2, 4
PARAMETERS = (0.5, -0.3)  # of the healthy machine: the first two columns
UNIT = np.array([1.0, 1.0, 4.0, 4.0])  # typical sizes of the columns
LOW, HIGH = 0.2, 8.0  # plausible magnitudes of both effects
FORMS = (Form("one", "a", (2,), LOW, HIGH), Form("two", "b", (3,), LOW, HIGH))
USUAL = ResidualNoise(np.ones(JOINTS), np.ones(JOINTS))
BASIS = polynomials(np.ones((1, BLOCK_ROWS, 1), dtype=np.bool_))[0, :, 0]  # (BLOCK_ROWS, POLYNOMIALS)


def rows(seed: int, sizes: tuple[float, float] = (0.0, 0.0), level: float = 1.0, scale: float = 1.0) -> np.ndarray:
    """Return rows (BLOCKS, BLOCK_ROWS, JOINTS, COLUMNS + 1), the residual last.

    level: of the discrepancy; scale: of the white noise
    """
    rng = np.random.default_rng(seed)
    columns = rng.standard_normal((BLOCKS, BLOCK_ROWS, JOINTS, COLUMNS)) * 0.3
    smooth = rng.standard_normal((BLOCKS, JOINTS, POLYNOMIALS)) * np.sqrt(DECAY) * level
    residual = columns @ np.array([*PARAMETERS, *sizes]) + np.einsum("tk,brk->btr", BASIS, smooth)
    residual += scale * rng.standard_normal(residual.shape)
    return np.concatenate([columns, residual[..., None]], axis=-1).astype(np.float32)


def blocks(found: np.ndarray) -> Blocks:
    """Return rows as blocks in which every row is usable."""
    return Blocks(found.astype(np.float32), np.ones(found.shape[:3], dtype=np.bool_))


def gram(found: np.ndarray, noise: SharedNoise | None = None) -> Gram:
    """Return the Gram matrices of rows; by default without sensor noise."""
    count = found.shape[-1] - 1
    return Gram.of(blocks(found), range(count), UNIT[:count], noise or SharedNoise.none(found.shape[2], count + 1))


def machine(variation: float = 0.0, noise: ResidualNoise = USUAL) -> MachineKnowledge:
    """Return the healthy machine: its parameters known to a hundredth, its effects to a twentieth of the least size."""
    error = np.array([0.01, 0.01, 0.05 * LOW / 4.0, 0.05 * LOW / 4.0])
    return MachineKnowledge(np.array([*PARAMETERS, 0.0, 0.0]), np.diag(error**2), np.full(COLUMNS, variation), noise)


def likelihood(found: np.ndarray, noise: SharedNoise | None = None) -> Likelihood:
    """Return the likelihood of rows beside the healthy machine."""
    return Likelihood(gram(found, noise), UNIT, FORMS, machine())
