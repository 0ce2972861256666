"""The service over a recording that is known as a whole: the same `step`, but the filtered rows are computed for all
samples at once, neither bytes nor forces are, and it is not asked whose machine it is. A fifth of the time of a replay,
the same bookings but for what errors that nobody notices add (a test compares them)."""

from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cylforce.estimation.kernel.inputs import NEVER
from cylforce.estimation.kernel.making import numbers
from cylforce.estimation.kernel.restricted import Numbers
from cylforce.service.contact.interaction import Forces, Interaction
from cylforce.service.pipeline import Instant, Pipe, Sizes
from cylforce.service.plausibility.monitor import Watch
from cylforce.service.recognition import Recognition
from cylforce.service.senders.inputs import Inputs
from cylforce.service.state import NOTHING_KEPT, Memory, State
from cylforce.service.step import Core, step
from cylforce.signals.estimate import Array, Reason, Sample, invalid_force
from cylforce.signals.events import Tick


class Recorded:
    """In place of frames and filters: gapless samples `values` (T, S) from tick `first` on, and their rows."""

    def __init__(self, core: Core, values: Array, first: int) -> None:
        self._core, self._values, self._first, self._k = core, values, first, 0
        self.fine = (Reason.NONE,) * values.shape[1]
        model = core.model
        moved = model.channels.run(values)
        self._rows, self._speed = model.filtered.run(moved.motion), moved.motion.speed
        self._channels, self.inertial = model.channels.read(values), model.channels.inertial
        usable = np.stack([moved.usable[:, list(acting)].all(axis=1) for acting in model.acting], axis=-1)
        ago = _since(~usable)
        self._waiting = np.maximum(model.settle_steps - ago, 0)

    still = array("d")
    decoders: dict[int, object] = {}  # noqa: RUF012 - none: there are no frames

    def begin(self, channels: Numbers | None = None) -> Any:  # noqa: ANN401 - in place of two classes
        """As the assembler and as the pipeline."""
        if channels is None:
            return Inputs(array("d", [0.0, 0.0, 0.0, NEVER, NEVER]), (0, 0, 0))
        return Pipe(0, array("d"), Sizes(0, 0, 0, 0))

    def receive(self, inputs: Inputs, *rest: object) -> Inputs:
        """As the assembler: there are no frames."""
        del rest
        return inputs

    def sample(self, inputs: Inputs, t_us: int) -> Sample:
        """As the assembler: the recorded one."""
        del inputs
        self._k = t_us // self._core.period_us - self._first
        return Sample(t_us, array("d", self._values[self._k].tolist()), self.fine, Reason.NONE)

    def came(self, inputs: Inputs) -> Numbers:
        """As the assembler: there are no frames whose times could be compared."""
        del inputs
        return array("d")

    def read(self, values: Array) -> Numbers:
        """As the pipeline: the channels of the last sample."""
        del values
        return numbers(self._channels[self._k])

    def moving(self, speed: Numbers) -> Numbers:
        """As the pipeline: no signal is looked at whether it is frozen."""
        del speed
        return self.still

    def advance(self, pipe: Pipe, channels: Numbers, periods: int) -> tuple[Pipe, Instant]:
        """As the pipeline: the rows of the last sample."""
        del periods, channels
        k = self._k - 1
        kept = numbers(np.append(self._rows.columns[k].ravel(), self._rows.torque[k]))
        usable = numbers(self._waiting[k] == 0.0)
        return pipe._replace(steps=pipe.steps + 1), Instant(kept, pipe.sizes, 0j, 0j, usable, numbers(self._speed[k]))


class _Known:
    """In place of the recognition: it is this machine."""

    def __init__(self, state: Recognition) -> None:
        self._state = state

    def begin(self) -> Recognition:
        return self._state

    def interrupt(self, state: Recognition) -> Recognition:
        return state

    def step(self, state: Recognition, *rest: object) -> Recognition:
        del rest
        return state


class _NoForces:
    """In place of the interaction: no force is known."""

    def __init__(self, state: Interaction) -> None:
        self._state, self._nothing = state, invalid_force(Reason.STARTING)

    def begin(self) -> Interaction:
        return self._state

    def interrupt(self, state: Interaction) -> Interaction:
        return state

    def step(self, state: Interaction, *rest: object) -> tuple[Interaction, Forces]:
        del rest
        return state, Forces(self._nothing, self._nothing)


class _Trusting:
    """In place of the monitor: no sensor is suspected."""

    def __init__(self, state: Watch) -> None:
        self._state = state

    def begin(self) -> Watch:
        return self._state

    def interrupt(self, state: Watch, **rest: object) -> Watch:
        del rest
        return state

    def step(self, state: Watch, *rest: object) -> Watch:
        del rest
        return state


def _since(marks: NDArray[np.bool_]) -> Array:
    """How many rows ago (T, R) a mark was set; very many where none was."""
    t = np.arange(len(marks))[:, None]
    last = np.maximum.accumulate(np.where(marks, t, -(10**6)), axis=0)
    return np.asarray(t - last)


def states(core: Core, values: Array, first: int = 1, kept: Memory = NOTHING_KEPT) -> Iterator[State]:
    """The states after each of the samples (T, S), the first of which is that of tick number `first`; the service
    starts with what was `kept`."""
    quick = Core(core.service._replace(publication=()), core.tares)
    recorded = Recorded(quick, values, first)
    parts = {"limits": core.limits, "assembler": recorded, "pipeline": recorded, "rocker": core.rocker}
    parts |= {"recognizer": _Known(core.recognizer.begin()), "interactor": _NoForces(core.interactor.begin())}
    parts |= {"monitor": _Trusting(core.monitor.begin())}
    quick.__dict__.update(parts)
    quick.model.__dict__["channels"] = recorded
    state = quick.begin(kept)
    for k in range(len(values)):
        state, _ = step(quick, state, Tick((first + k) * core.period_us))
        yield state
