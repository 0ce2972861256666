"""Discrete low-pass filters: `step` for one live sample, `run` for a recording, with the same result to rounding.

Only recordings need scipy.signal. It is loaded when one is filtered: the service does without its 50 MB."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import pi, sqrt, tan

import numpy as np

from cylforce.signals.estimate import Array

STRETCH_S = 10.0  # s, length of the stretches over which `denoised` averages spectra; chosen
NOISE_MARGIN = 1.0  # relative standard errors of the averaged spectrum by which a signal must exceed noise; chosen


@dataclass(frozen=True)
class Filter:
    """Linear filter b(z)/a(z) in transposed direct form II, a[0] = 1. Its state has the shape (order, *shape of a
    sample).

    b: coefficients of the numerator
    a: coefficients of the denominator
    """

    b: tuple[float, ...]
    a: tuple[float, ...]

    @cached_property
    def delay(self) -> float:
        """Delay of slow signals [samples]: the group delay at frequency zero."""
        late = [float(np.arange(len(c)) @ np.array(c)) / float(np.sum(c)) for c in (self.b, self.a)]
        return late[0] - late[1]

    def zero(self, shape: tuple[int, ...]) -> Array:
        """Return the state (order, *shape) after an input of zeros, for samples of this shape."""
        return np.zeros((len(self.a) - 1, *shape))

    def steady(self, x: Array) -> Array:
        """Return the state settled at the constant input x: with gain 1 the output is x from the first sample."""
        return np.asarray(self._settled.reshape(-1, *([1] * np.ndim(x))) * x)

    @cached_property
    def _settled(self) -> Array:
        """State (order,) settled at the input 1: z = A z + B, with A the transposed companion matrix of a, and B = b -
        a b[0]."""
        a, b = np.array(self.a), np.array(self.b)
        left = np.eye(len(a) - 1) - np.eye(len(a) - 1, k=1)
        left[:, 0] += a[1:]
        return np.linalg.solve(left, b[1:] - a[1:] * b[0])

    def rest(self, x: Array) -> Array:
        """Return the state settled at the constant input x, for a filter with sum(b) = 0, whose output then is zero."""
        return np.stack([-np.sum(self.b[:k]) * x for k in range(1, len(self.b))])

    def step(self, state: Array, x: Array) -> tuple[Array, Array]:
        """Return the filter's state (order, *shape) and its output (*shape) after one sample x (*shape).

        state: (order, *shape) before the sample

        The operations are in the order of `run`, so that both round alike."""
        y = state[0] + self.b[0] * x
        later, fed_back = self._later[np.ndim(x)]
        new = later * x
        new[:-1] += state[1:]
        new -= fed_back * y
        return new, y

    @cached_property
    def _later(self) -> list[tuple[Array, Array]]:
        """Coefficients b and a after the first ones, (order, 1, ...), by the number of axes of a sample."""
        shapes = [(-1, *[1] * axes) for axes in range(4)]
        return [(np.reshape(self.b[1:], shape), np.reshape(self.a[1:], shape)) for shape in shapes]

    def run(self, state: Array, x: Array) -> tuple[Array, Array]:
        """Return the filter's state after a recording x (T, *shape), and its output (T, *shape).

        state: (order, *shape) before the recording
        """
        from scipy.signal import lfilter

        y, end = lfilter(self.b, self.a, x, axis=0, zi=state)
        return end, y


def first_order(cutoff_hz: float, dt: float) -> Filter:
    """Return the low-pass of first order L = w/(s + w), w = 2 pi cutoff_hz, by Tustin's rule (mechanics/README.md, 5).

    y_k = ((1-a) y_{k-1} + a (x_k + x_{k-1}))/(1+a), a = w dt/2

    cutoff_hz: -3 dB frequency [Hz]
    dt:        fixed step [s]
    """
    a = pi * cutoff_hz * dt
    return Filter((a / (1 + a), a / (1 + a)), (1.0, -(1 - a) / (1 + a)))


def poles(*stages: Filter) -> Filter:
    """Return the low-passes `stages` in series, with their poles only and gain 1.

    `mean` of its last four outputs adds the zeros; `slope` of the same outputs gives the derivative. Both therefore
    need one filter only."""
    a = np.ones(1)
    for stage in stages:
        a = np.convolve(a, stage.a)
    return Filter((float(np.sum(a)), *[0.0] * (len(a) - 1)), tuple(float(v) for v in a))


def mean(four: Array) -> Array:
    """Return the mean over four consecutive samples (4, ...) by Simpson's 3/8 rule, weights (1, 3, 3, 1)/8.

    These are the coefficients of (1 + z)^3/8: the zeros of a first- and a second-order low-pass by Tustin's rule.
    `poles` followed by `mean` are therefore those low-passes in series, or one of second order and the mean of two
    samples."""
    return np.asarray((four[0] + four[3] + 3.0 * (four[1] + four[2])) / 8.0)


def slope(four: Array, dt: float) -> Array:
    """Return the mean rate over four consecutive samples (4, ...), `dt` [s] apart.

    It is the derivative of `mean` to a relative error of (w dt)^4/80 at angular frequency w. The difference of two
    samples exceeds the derivative of their mean by (w dt)^2/12, so that an estimated inertia would be too small: by 0.4
    % at 2.5 Hz and 100 samples per second."""
    return np.asarray((four[3] - four[0]) / (3.0 * dt))


def fours(x: Array) -> Array:
    """Return all groups of four consecutive samples (4, T-3, ...) of x (T, ...)."""
    return np.stack([x[k : len(x) - 3 + k] for k in range(4)])


def denoised(x: Array, rate_hz: float) -> Array:
    """Return a recording x (T,) of one sensor with its white noise removed, without delay (Wiener filter, 1949).

    rate_hz: samples per second [Hz]

    The noise level is the mean power in the upper half of the frequencies. Each frequency is multiplied by the share of
    its power that is not noise. It is removed when its power does not clearly exceed the noise (NOISE_MARGIN). The mean
    is kept. A regression on the result is not biased by the noise."""
    from scipy.signal import welch

    length = min(len(x), round(STRETCH_S * rate_hz))
    f, power = welch(x, rate_hz, nperseg=length)
    level = float(np.mean(power[f > rate_hz / 4.0]))
    clear = level * (1.0 + NOISE_MARGIN * np.sqrt(length / len(x)))  # power beyond which it cannot be noise alone
    share = np.where(power > clear, 1.0 - level / np.maximum(power, 1e-300), 0.0)
    share[0] = 1.0
    around = np.concatenate([2.0 * x[0] - x[:0:-1], x, 2.0 * x[-1] - x[-2::-1]])
    spectrum = np.fft.rfft(around)
    kept = np.interp(np.fft.rfftfreq(len(around), 1.0 / rate_hz), f, share)
    return np.asarray(np.fft.irfft(spectrum * kept, len(around))[len(x) - 1 : 2 * len(x) - 1])


@lru_cache
def second_order(cutoff_hz: float, dt: float) -> Filter:
    """Return the Butterworth low-pass of second order, w^2/(s^2 + sqrt(2) w s + w^2), by Tustin's rule with the cut-off
    kept.

    w = k 2/dt, k = tan(pi cutoff_hz dt). Raises ValueError unless the cut-off lies below half the sampling rate.

    cutoff_hz: -3 dB frequency [Hz]
    dt:        fixed step [s]
    """
    if not 0.0 < cutoff_hz * dt < 0.5:
        raise ValueError(f"a cut-off of {cutoff_hz:g} Hz does not lie below half of {1.0 / dt:g} samples a second")
    k = tan(pi * cutoff_hz * dt)
    whole = 1.0 + sqrt(2.0) * k + k * k
    gain = k * k / whole
    return Filter((gain, 2.0 * gain, gain), (1.0, 2.0 * (k * k - 1.0) / whole, (1.0 - sqrt(2.0) * k + k * k) / whole))
