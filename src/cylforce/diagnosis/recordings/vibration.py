"""Vibration, as of the engine or its pump: a spectral line at one frequency in several sensors at once, found in the
raw readings above the frequencies that the service passes. The filters take it off, so that nothing else here sees it.

The spectrum of every stretch is divided by its own background beside each frequency, so that neither knocks nor motion
count; of white noise the mean of K such ratios is Gamma distributed, mean 1, shape K."""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import bdtrc, gammaincc

from cylforce.diagnosis.columns.recorded import Recorded
from cylforce.diagnosis.numbers import SHAKES, VIBRATES
from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import Machine
from cylforce.signals.estimate import Array

STRETCH_S = 2.0  # s of one spectrum: in so long an engine under load keeps its speed within half a hertz or so
BESIDE_HZ = 5.0  # the background of a frequency: the median so far to either side
LOBE = 2  # frequencies to either side over which the window spreads a line
SEVERAL = 2  # sensors at least: a line in one alone may be its own


class SpectralLine(NamedTuple):
    """What a sensor shows of a vibration, amplitudes in SI units: in the field, and in the references (None without
    any); whether it `grew`: SHAKES times what the references show."""

    sensor: str
    amplitude: float
    before: float | None
    grew: bool


class Vibration(NamedTuple):
    """A vibration: its frequency as it is seen [Hz] (a faster one is seen at less than half the sampling rate), and the
    sensors that show it, the clearest first."""

    frequency_hz: float
    sensors: tuple[SpectralLine, ...]


class Spectra(NamedTuple):
    """Of recordings: frequencies (F,) [Hz]; mean power over the background (F, S); square of a line's amplitude (F, S)
    that the power at a frequency stands for, the background taken off; the number of stretches."""

    hz: Array
    ratio: Array
    square: Array
    stretches: int


def vibrations(
    machine: Machine, filters: Filters, faulty: Sequence[Recorded], clean: Sequence[Recorded]
) -> list[Vibration]:
    """The vibrations seen in the field, the clearest first, where they are no less than a sensor's declared noise."""
    declared = np.array([s.standard_error for s in machine.signals])
    seen, before = (spectra(filters, declared, group) for group in (faulty, clean))
    if seen is None:
        return []
    chance = gammaincc(seen.stretches, seen.stretches * seen.ratio)  # (F, S) of noise alone
    found: list[Vibration] = []
    for k in _lines(seen):
        order = np.argsort(-seen.ratio[k], kind="stable")[: max(SEVERAL, np.sum(chance[k] < VIBRATES / chance.size))]
        shown = [s for s in order.tolist() if _amplitude(seen, k, s) > declared[s]]
        lines = tuple(_line(machine, s, _amplitude(seen, k, s), before and _amplitude(before, k, s)) for s in shown)
        found += [Vibration(float(seen.hz[k]), lines)] if len(lines) >= SEVERAL else []
    return found


def _line(machine: Machine, s: int, amplitude: float, before: float | None) -> SpectralLine:
    return SpectralLine(machine.signals[s].name, amplitude, before, before is not None and amplitude > SHAKES * before)


def _lines(seen: Spectra) -> list[int]:
    """The frequencies of lines, the clearest first, without those beside a clearer one: so clear in SEVERAL sensors
    that noise alone would show less than VIBRATES of them."""
    clear = np.sort(seen.ratio, axis=1)[:, -SEVERAL]
    chance = gammaincc(seen.stretches, seen.stretches * clear)
    false = len(seen.hz) * bdtrc(SEVERAL - 1, seen.ratio.shape[1], chance)
    found: list[int] = []
    for k in np.argsort(-clear, kind="stable")[: np.count_nonzero(false < VIBRATES)].tolist():
        found += [k] if all(abs(k - other) > 2 * LOBE for other in found) else []
    return found


def _amplitude(seen: Spectra, k: int, s: int) -> float:
    """Of a line at frequency k, over which the window, and the engine's speed, spread it."""
    return float(np.sqrt(max(np.sum(seen.square[max(k - LOBE, 0) : k + LOBE + 1, s]), 0.0)))


def spectra(filters: Filters, declared: Array, recordings: Sequence[Recorded]) -> Spectra | None:
    """Spectra of all whole stretches, above the frequencies that the service passes; None if there are none. The
    background is no less than that of the noise `declared` (S,), standard deviations."""
    size = round(STRETCH_S * filters.rate_hz)
    parts = [r.values[a:b] for r in recordings for a, b in pairwise(range(0, len(r.values) + 1, size))]
    whole = [part for part in parts if np.all(np.isfinite(part))]
    if not whole:
        return None
    window = np.hanning(size + 1)[:-1, None]
    hz = np.fft.rfftfreq(size, 1.0 / filters.rate_hz)
    power = np.stack([np.abs(np.fft.rfft(window * (part - part.mean(axis=0)), axis=0)) ** 2 for part in whole])
    near = 2 * round(BESIDE_HZ * STRETCH_S) + 1
    beside = median_filter(power, (1, near, 1), mode="mirror") / np.log(2.0)  # mean of what is exponential
    beside = np.maximum(beside, declared**2 * np.sum(window**2))
    ratio: Array = np.mean(power / beside, axis=0)
    square = (ratio - 1.0) / np.mean(1.0 / beside, axis=0) * 4.0 / (size * np.sum(window**2))
    above = (hz > filters.channel_hz) & (hz < filters.rate_hz / 2.0)
    return Spectra(hz[above].astype(np.float64), ratio[above], square[above], len(whole))


def vibrating(each: Sequence[Vibration], rate_hz: float) -> str:
    """A sentence that names vibrations that grew; empty if there are none."""
    found = []
    for v in each:
        grown = [f"{line.sensor} {line.amplitude:.2g}" for line in v.sensors if line.grew]
        same = f"{v.frequency_hz:.1f} Hz (or {rate_hz - v.frequency_hz:.1f} Hz, which is read as the same)"
        found += [f"{same}: {', '.join(grown)}"] if len(grown) >= SEVERAL else []
    words = f"vibration that the references do not show, amplitude in SI units: {'; '.join(found)}: of the engine, the "
    return words + "pump and their mounts, or the arm swings" if found else ""
