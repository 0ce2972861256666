"""The force as it is published, against the true force at that moment, which passed no filter: error vector, direction,
bandwidth and delay, coverage of its standard error.

Bandwidth and delay are measured by a sine and a step of true force: joint torques of a known force are added to the
pressures of a machine that moves in the air."""

import json
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from cylforce.commissioning.identification import identify
from cylforce.effects.loads.tip_force import tip_torque
from cylforce.programs.common.readings import model_of
from cylforce.service.core import Core
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import load
from cylforce.signals.codec import encode
from cylforce.signals.estimate import Array, Estimate
from cylforce.signals.events import Frame
from cylforce.signals.kinds import Kind
from studies._contacts import Run, resultant, wanted
from studies.recognition import run as simulated
from studies.unexplained import ROOT

LARGE = 10e3  # N: below it a relative error says nothing
CONTACTS = ("press", "drag", "soil", "buried", "tip_load", "digging")
STEP_N, SINE_N = 20e3, 10e3
STEPS_S = tuple(6.0 + 0.0025 * k for k in range(8))  # over one publication period
# The plausibility looks at the force each 0.2 s: from 7.5 Hz on these are odd multiples of 2.5 Hz, of which a look sees
# the opposite of the next one. Of others it would see a force that drives the tool, which nothing in the air does.
SINES_HZ = (1.0, 2.0, 3.0, 5.0, 7.5, 12.5, 17.5, 22.5)

Encode = Callable[[Array, int], Iterable[Frame]]


class Score(NamedTuple):
    """One recording: errors above LARGE, 95th percentiles; errors in the air (95th percentile of the vector, N); share
    of 95 % intervals of both components that contain the truth, in contact and in the air; share of all samples of
    which a component is beyond three standard errors; share of samples with a value; how late [ms] the published force
    fits the truth best."""

    machine: str
    kind: str
    p95_relative: float
    p95_direction_deg: float
    air_n: float
    coverage: float
    coverage_air: float
    beyond_three: float
    published: float
    lag_ms: float


def score(run: Run, what: str = "force") -> Score:
    """The score of a recording; `what`: the resultant (force) or the force of the soil alone (soil)."""
    (found, error), true = run.found(what), resultant(run) if what == "force" else run.force
    known = np.asarray(np.isfinite(found).all(axis=1))
    size, off = np.hypot(*true.T), np.hypot(*(found - true).T)
    large, air = known & (size > LARGE), known & (size < 1.0) & (run.mass < 1.0)
    inside, beyond = np.abs(found - true) < 1.96 * error, np.abs(found - true) > 3.0 * error
    turned = np.degrees(np.abs(np.angle((found @ (1, 1j)) * np.conj(true @ (1, 1j)))))
    return Score(
        machine=run.machine,
        kind=run.kind,
        p95_relative=quantile(off[large] / size[large]),
        p95_direction_deg=quantile(turned[large]),
        air_n=quantile(off[air]),
        coverage=float(inside[large].mean()) if large.any() else float("nan"),
        coverage_air=float(inside[air].mean()) if air.any() else float("nan"),
        beyond_three=float(beyond[known].any(axis=1).mean()) if known.any() else float("nan"),
        published=float(known[size > LARGE].mean()) if large.any() else float("nan"),
        lag_ms=lag_ms(run.t_s, found, true) if large.any() else float("nan"),
    )


def quantile(values: Array, share: float = 95.0) -> float:
    """A percentile; NaN of nothing."""
    return float(np.percentile(values, share)) if len(values) else float("nan")


def lag_ms(t_s: Array, found: Array, true: Array) -> float:
    """By how much the published force [ms] is shifted where it fits the truth best (least squares)."""
    known = np.asarray(np.isfinite(found).all(axis=1))

    def misfit(late: float) -> float:
        shifted = np.column_stack([np.interp(t_s - late, t_s, axis) for axis in true.T])
        return float(np.sum((found - shifted)[known] ** 2))

    return 1e3 * float(min(np.arange(0.0, 0.4, 0.005).tolist(), key=misfit))


def with_force(core: Core, values: Array, force: Array) -> Array:
    """Samples (T, S) of a machine with a `force` (T, 2) [N] on the tool in addition, which its cylinders carry."""
    machine, changed = core.service.machine, values.copy()
    channels = core.model.channels.course(values)
    moving = core.model.channels.moved(channels, np.zeros_like(channels)).motion
    torque = tip_torque(machine, moving, force)[:, list(machine.rows)]
    cylinders = np.linalg.solve(np.swapaxes(moving.lever, 1, 2)[:, list(machine.rows)], torque[..., None])[..., 0]
    for k, signal in enumerate(machine.signals):
        if signal.kind is Kind.HEAD_PRESSURE:
            changed[:, k] += np.maximum(cylinders[:, signal.index], 0.0) / machine.cylinders[signal.index].area_head
        elif signal.kind is Kind.ROD_PRESSURE:
            changed[:, k] -= np.minimum(cylinders[:, signal.index], 0.0) / machine.cylinders[signal.index].area_rod
    return changed


def published_course(core: Core, values: Array, first_us: int, encode: Encode) -> list[Estimate]:
    """What is on the bus at each step after the samples were measured there: at a tick the service uses the samples of
    the tick before, and sends only at every publication."""
    weighing, shown, period = WeighingService.start(core), [], round(1e6 / core.service.filters.rate_hz)
    every = max(1, round(core.service.publication[1].period_s * core.service.filters.rate_hz))
    last = weighing.estimate
    for k, row in enumerate(values):
        for frame in encode(row, first_us + k * period):
            weighing.on_frame(frame)
        estimate = weighing.on_tick(first_us + (k + 1) * period)
        if (k + 1) % every == 0:
            last = estimate
        shown.append(last)
    return shown


def encoder(core: Core) -> Encode:
    """A function (row of SI values, time [us]) -> the frames of all sensors."""
    pdos = [pdo for node in core.service.nodes for pdo in node.pdos]
    names = [signal.name for signal in core.service.machine.signals]
    unknown = dict.fromkeys((f.signal for p in pdos for f in p.fields if f.signal), float("nan"))

    def frames(row: Array, t_us: int) -> Iterator[Frame]:
        said = unknown | dict(zip(names, row.tolist(), strict=True))
        return (Frame(t_us, pdo.can_id, encode(pdo, said)) for pdo in pdos)

    return frames


def response(core: Core, values: Array) -> dict[str, float]:
    """`delay_ms`: mean time from a step of true force to half of it on the bus, over steps at all moments of a
    publication period; `delay_worst_ms`: the longest; `bandwidth_hz`: where a sine of true force is 3 dB smaller on the
    bus. From the difference between a course with the force and the same one without it."""
    rate = core.service.filters.rate_hz
    encode, t = encoder(core), np.arange(len(values)) / rate
    base = _x(published_course(core, values, 0, encode))

    def answer(push: NDArray[np.floating]) -> Array:
        force = np.column_stack([push, np.zeros(len(t))])
        return _x(published_course(core, with_force(core, values, force), 0, encode)) - base

    delays = [_half(answer(STEP_N * (t >= at)), t, at, rate) for at in STEPS_S]
    gains = [_gain(answer(SINE_N * np.sin(2.0 * np.pi * hz * t)), t, hz) for hz in SINES_HZ]
    below = [k for k, gain in enumerate(gains) if gain < np.sqrt(0.5)]
    band = float(np.interp(-np.sqrt(0.5), -np.array(gains), SINES_HZ)) if below else SINES_HZ[-1]
    return {"delay_ms": float(np.mean(delays)), "delay_worst_ms": float(max(delays)), "bandwidth_hz": band}


def _x(course: list[Estimate]) -> Array:
    return np.asarray(np.nan_to_num(np.array([e.force.x.value for e in course])), dtype=np.float64)


def _half(answer: Array, t: Array, at: float, rate: float) -> float:
    """Time [ms] from `at` until half the step is on the bus; row k is on the bus one step after it was measured."""
    reached = np.flatnonzero((answer > STEP_N / 2.0) & (t >= at - 1.0 / rate))
    return float(1e3 * (t[reached[0]] + 1.0 / rate - at))


def _gain(answer: Array, t: Array, hz: float) -> float:
    late = t >= 5.0
    wave = np.exp(-2j * np.pi * hz * t[late])
    return float(2.0 * np.abs(np.mean(answer[late] * wave)) / SINE_N)


def summary(scores: list[Score], answer: dict[str, float]) -> dict[str, Any]:
    """Worst of all recordings by kind, and over all kinds but the buried object."""
    kinds = {kind: [s for s in scores if s.kind == kind] for kind in dict.fromkeys(s.kind for s in scores)}
    usual = [s for s in scores if s.kind in CONTACTS and s.kind != "buried" and np.isfinite(s.p95_relative)]
    found: dict[str, Any] = {
        "p95_relative": max((s.p95_relative for s in usual), default=None),
        "p95_direction_deg": max((s.p95_direction_deg for s in usual), default=None),
        "coverage": float(np.mean([s.coverage for s in usual])) if usual else None,
        "coverage_worst": min((s.coverage for s in usual), default=None),
        "coverage_air": float(np.nanmean([s.coverage_air for s in scores])),
    }
    return found | answer | {"kinds": kinds_worst(kinds), "recordings": [s._asdict() for s in scores]}


def kinds_worst(kinds: dict[str, list[Score]]) -> dict[str, dict[str, float]]:
    """The worst recording of each kind."""
    return {
        kind: {
            "recordings": len(each),
            "p95_relative": float(np.max([s.p95_relative for s in each])),
            "p95_direction_deg": float(np.max([s.p95_direction_deg for s in each])),
            "lag_ms": float(np.max([s.lag_ms for s in each])),
            "air_n": float(np.max([s.air_n for s in each])),
            "coverage": float(np.mean([s.coverage for s in each])),
            "coverage_air": float(np.mean([s.coverage_air for s in each])),
            "beyond_three": float(np.max([s.beyond_three for s in each])),
        }
        for kind, each in kinds.items()
    }


def in_the_air(seed: int) -> tuple[Core, Array]:
    """Core of our own simulated excavator, and 12 s of its samples while it moves in the air."""
    loaded = load(ROOT / "config" / "excavator_20t.toml")
    moves = simulated(loaded, "moves", seed, 120.0)
    return Core(loaded.service, identify(model_of(loaded), [moves]).tares), moves[1000:2200]


def main() -> None:
    """Measure and print."""
    options = wanted("force", __doc__, ("tip_load", "digging", "air", "sharp"))
    scores = [score(run) for run in options.runs]
    figures = summary(scores, response(*in_the_air(options.seed)))
    console = Console(highlight=False)
    console.print(_table(scores))
    named = ("p95_relative", "p95_direction_deg", "coverage", "coverage_worst", "coverage_air")
    for name in (*named, "delay_ms", "delay_worst_ms", "bandwidth_hz"):
        console.print(f"{name}: {figures[name]:.4g}")
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


def _table(scores: list[Score]) -> Table:
    table = Table(title="The published force against the true one at that moment")
    for name in Score._fields:
        table.add_column(name.replace("_", " "))
    for s in scores:
        table.add_row(*(f"{v:.3g}" if isinstance(v, float) else v for v in s))
    return table


if __name__ == "__main__":
    main()
