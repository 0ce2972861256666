"""Vibration of an engine or its pump: a spectral line at one frequency in several sensors at once.

It is found in the raw readings above the frequencies that the service passes. The filters remove it, so that nothing
else shows it. The spectrum of every stretch is divided by its own background beside each frequency, so that neither
knocks nor motion count. The mean of K such ratios of white noise is Gamma distributed with mean 1 and shape K."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import median_filter
from scipy.special import bdtrc, gammaincc

from cylforce.mechanics.installation import Filters
from cylforce.mechanics.machine import Machine
from cylforce.readings.constants import FALSE_LINES, NOISY
from cylforce.readings.recording import Recording
from cylforce.signals.estimate import Array

STRETCH_S = 2.0  # s of one spectrum: in so long an engine under load keeps its speed within half a hertz or so
BACKGROUND_HZ = 5.0  # to either side, over which the background of a frequency is the median
LOBE = 2  # frequencies to either side over which the window spreads a line
SEVERAL = 2  # sensors at least: a line in one alone may be its own


@dataclass(frozen=True)
class SpectralLine:
    """A vibration as one sensor shows it, amplitudes in SI units.

    sensor:    its name
    amplitude: in the field recordings
    before:    in the references; None without any
    grew:      whether it is NOISY times as large as in the references
    """

    sensor: str
    amplitude: float
    before: float | None
    grew: bool


@dataclass(frozen=True)
class Vibration:
    """A vibration.

    frequency_hz: as it is seen: a faster one than half the sampling rate is seen mirrored there
    sensors:      that show it, the clearest first
    """

    frequency_hz: float
    sensors: tuple[SpectralLine, ...]


@dataclass(frozen=True)
class Spectra:
    """Mean spectra of recordings: F frequencies, S sensors.

    hz:        (F,) frequencies [Hz]
    ratio:     (F, S) power over the background
    square:    (F, S) square of the amplitude of a line that has this power, without the background
    stretches: their number
    """

    hz: Array
    ratio: Array
    square: Array
    stretches: int


def vibrations(
    machine: Machine, filters: Filters, field: Sequence[Recording], references: Sequence[Recording]
) -> list[Vibration]:
    """Return the vibrations of the field, the clearest first, where they exceed a sensor's declared noise."""
    declared = np.array([s.standard_error for s in machine.signals])
    seen, before = (spectra(filters, declared, group) for group in (field, references))
    if seen is None:
        return []
    chance = gammaincc(seen.stretches, seen.stretches * seen.ratio)  # (F, S) of noise alone
    found: list[Vibration] = []
    for k in _lines(seen):
        order = np.argsort(-seen.ratio[k], kind="stable")
        clear = order[: max(SEVERAL, np.sum(chance[k] < FALSE_LINES / chance.size))].tolist()
        shown = [s for s in clear if _amplitude(seen, k, s) > declared[s]]
        lines = tuple(
            _line(machine, s, _amplitude(seen, k, s), None if before is None else _amplitude(before, k, s))
            for s in shown
        )
        found += [Vibration(float(seen.hz[k]), lines)] if len(lines) >= SEVERAL else []
    return found


def _line(machine: Machine, s: int, amplitude: float, before: float | None) -> SpectralLine:
    return SpectralLine(machine.signals[s].name, amplitude, before, before is not None and amplitude > NOISY * before)


def _lines(seen: Spectra) -> list[int]:
    """Return the numbers of the frequencies of lines, the clearest first, without those beside a clearer one.

    A line is so clear in SEVERAL sensors that noise alone would show fewer than FALSE_LINES of them.
    """
    clear = np.sort(seen.ratio, axis=1)[:, -SEVERAL]
    chance = gammaincc(seen.stretches, seen.stretches * clear)
    false = len(seen.hz) * bdtrc(SEVERAL - 1, seen.ratio.shape[1], chance)
    found: list[int] = []
    for k in np.argsort(-clear, kind="stable")[: np.count_nonzero(false < FALSE_LINES)].tolist():
        found += [k] if all(abs(k - other) > 2 * LOBE for other in found) else []
    return found


def _amplitude(seen: Spectra, k: int, s: int) -> float:
    """Return the amplitude of a line at frequency k, over which the window and the engine's speed spread it."""
    return float(np.sqrt(max(np.sum(seen.square[max(k - LOBE, 0) : k + LOBE + 1, s]), 0.0)))


def spectra(filters: Filters, declared: Array, recordings: Sequence[Recording]) -> Spectra | None:
    """Return the spectra of all whole stretches above the frequencies that the service passes; None without any.

    declared: (S,) standard deviation of the sensors' noise: the background is no less than its
    """
    size = round(STRETCH_S * filters.rate_hz)
    parts = [r.values[a:b] for r in recordings for a, b in pairwise(range(0, len(r.values) + 1, size))]
    whole = [part for part in parts if np.all(np.isfinite(part))]
    if not whole:
        return None
    window = np.hanning(size + 1)[:-1, None]
    hz = np.fft.rfftfreq(size, 1.0 / filters.rate_hz)
    power = np.stack([np.abs(np.fft.rfft(window * (part - part.mean(axis=0)), axis=0)) ** 2 for part in whole])
    near = 2 * round(BACKGROUND_HZ * STRETCH_S) + 1
    background = median_filter(power, (1, near, 1), mode="mirror") / np.log(2.0)  # mean of an exponential
    background = np.maximum(background, declared**2 * np.sum(window**2))
    ratio: Array = np.mean(power / background, axis=0)
    square = (ratio - 1.0) / np.mean(1.0 / background, axis=0) * 4.0 / (size * np.sum(window**2))
    above = (hz > filters.channel_hz) & (hz < filters.rate_hz / 2.0)
    return Spectra(hz[above].astype(np.float64), ratio[above], square[above], len(whole))


def vibration_warning(found: Sequence[Vibration], rate_hz: float) -> str:
    """Return a sentence that names vibrations that grew; empty if there are none."""
    said = []
    for vibration in found:
        grown = [f"{line.sensor} {line.amplitude:.2g}" for line in vibration.sensors if line.grew]
        seen = vibration.frequency_hz
        same = f"{seen:.1f} Hz (or {rate_hz - seen:.1f} Hz, which is read as the same)"
        said += [f"{same}: {', '.join(grown)}"] if len(grown) >= SEVERAL else []
    words = f"vibration that the references do not show, amplitude in SI units: {'; '.join(said)}: of the engine, the "
    return words + "pump and their mounts, or the arm swings" if said else ""
