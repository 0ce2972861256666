"""Discrete low-pass filters: one step for a live sample, one run for a recording; both give the same to rounding."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import pi

import numpy as np
from scipy import signal

from cylforce.signals.estimate import Array

STRETCH_S = 10.0  # stretches whose spectra are averaged
SURE = 1.0  # standard errors of such a mean


@dataclass(frozen=True)
class Filter:
    """A linear filter b(z)/a(z) in transposed direct form II; a state has shape (order, *shape of a sample)."""

    b: tuple[float, ...]
    a: tuple[float, ...]

    @cached_property
    def delay(self) -> float:
        """By how many samples what is slow comes late: the group delay at frequency zero."""
        late = [float(np.arange(len(c)) @ np.array(c)) / float(np.sum(c)) for c in (self.b, self.a)]
        return late[0] - late[1]

    def zero(self, shape: tuple[int, ...]) -> Array:
        """The state of a filter that has seen nothing but zeros."""
        return np.zeros((len(self.a) - 1, *shape))

    def steady(self, x: Array) -> Array:
        """The state in which the constant input x has settled: the output then is x from the first sample."""
        return np.asarray(self._settled.reshape(-1, *([1] * np.ndim(x))) * x)

    @cached_property
    def _settled(self) -> Array:
        """The state that the constant input 1 leads to."""
        return np.asarray(signal.lfilter_zi(self.b, self.a))

    def rest(self, x: Array) -> Array:
        """The state in which a filter that lets nothing constant pass, sum(b) = 0, has been shown x for ever."""
        return np.stack([-np.sum(self.b[:k]) * x for k in range(1, len(self.b))])

    def step(self, state: Array, x: Array) -> tuple[Array, Array]:
        """One sample: (new state, output); operations in the order of `run`, so that both round alike."""
        y = state[0] + self.b[0] * x
        new = np.empty_like(state)
        for k in range(1, len(self.b) - 1):
            new[k - 1] = state[k] + x * self.b[k] - y * self.a[k]
        new[-1] = x * self.b[-1] - y * self.a[-1]
        return new, y

    def run(self, state: Array, x: Array) -> tuple[Array, Array]:
        """A recording x (T, *shape): (state after it, output (T, *shape))."""
        y, end = signal.lfilter(self.b, self.a, x, axis=0, zi=state)
        return end, y


def first_order(cutoff_hz: float, dt: float) -> Filter:
    """L = w/(s + w) by Tustin's rule: y_k = ((1-a) y_{k-1} + a (x_k + x_{k-1}))/(1+a), a = w dt/2
    (mechanics/README.md, section 5)."""
    a = pi * cutoff_hz * dt
    return Filter((a / (1 + a), a / (1 + a)), (1.0, -(1 - a) / (1 + a)))


def poles(*stages: Filter) -> Filter:
    """Low-passes one after the other without their zeros, which `mean` puts back: what follows may so choose between
    means and slopes of what they filter."""
    a = np.ones(1)
    for stage in stages:
        a = np.convolve(a, stage.a)
    return Filter((float(np.sum(a)), *[0.0] * (len(a) - 1)), tuple(float(v) for v in a))


def mean(four: Array) -> Array:
    """The mean of a stretch of four samples (4, ...) by Simpson's 3/8 rule. It equals that of the means of neighbours
    of the means of three, (1 + z)^3/8: with `poles` before it, low-passes by Tustin's rule and the middle between two
    samples."""
    return np.asarray((four[0] + four[3] + 3.0 * (four[1] + four[2])) / 8.0)


def slope(four: Array, dt: float) -> Array:
    """The mean rate over the same stretch: slope = d(mean)/dt but for (w dt)^4/80. The difference of two samples beside
    their mean is too large by (w dt)^2/12, and squared it makes an inertia too small: 0.4 % at 2.5 Hz and 100 Hz."""
    return np.asarray((four[3] - four[0]) / (3.0 * dt))


def fours(x: Array) -> Array:
    """All stretches of four neighbours (4, T-3, ...) of x (T, ...)."""
    return np.stack([x[k : len(x) - 3 + k] for k in range(4)])


def denoised(x: Array, rate_hz: float) -> Array:
    """A recording (T,) without its sensor's white noise, nothing delayed (Wiener 1949): every frequency counts by the
    share of it that is no noise, whose level is that of the upper half of the frequencies. A regression on what is left
    is not biased by the noise, and a recording of nothing but noise leaves next to nothing."""
    length = min(len(x), round(STRETCH_S * rate_hz))
    f, power = signal.welch(x, rate_hz, nperseg=length)
    level = float(np.mean(power[f > rate_hz / 4.0]))
    clear = level * (1.0 + SURE * np.sqrt(length / len(x)))  # what noise alone does not reach
    share = np.where(power > clear, 1.0 - level / np.maximum(power, 1e-300), 0.0)
    share[0] = 1.0
    around = np.concatenate([2.0 * x[0] - x[:0:-1], x, 2.0 * x[-1] - x[-2::-1]])
    spectrum = np.fft.rfft(around)
    kept = np.interp(np.fft.rfftfreq(len(around), 1.0 / rate_hz), f, share)
    return np.asarray(np.fft.irfft(spectrum * kept, len(around))[len(x) - 1 : 2 * len(x) - 1])


@lru_cache
def second_order(cutoff_hz: float, dt: float) -> Filter:
    """Butterworth low-pass of second order; the cut-off must lie below half the sampling rate."""
    b, a = signal.butter(2, cutoff_hz, fs=1.0 / dt)
    return Filter(tuple(float(v) for v in b), tuple(float(v) for v in a))
