"""`cylforce commission`: commissioning with live guidance for the operator who moves the empty machine.

Identification from the recording follows and, on request, the scale from a known weight. It never commands the machine.
"""

import asyncio
import os
import sys
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.text import Text

from cylforce.can.bus import Bus, BusError
from cylforce.can.clock import now_us
from cylforce.can.opening import open_shared_bus
from cylforce.commissioning.guidance import GOOD_ENOUGH, Guide
from cylforce.commissioning.identification import MIN_SECONDS, Identification, attachment_prior
from cylforce.estimation.model import Tares
from cylforce.files.atomic import RecordingError, check_outputs
from cylforce.files.logfile import LogWriter, file_sha256
from cylforce.mechanics.installation import STANDARD
from cylforce.programs.common.progress import progress_bar
from cylforce.programs.common.readings import calibrated, check_known_kg, header_of, model_of, tool_models
from cylforce.programs.identify import How, run_identify, show
from cylforce.programs.live.collector import Collector, View
from cylforce.programs.live.messages import configure_messages
from cylforce.programs.live.picture import Screen, known, picture, summary
from cylforce.programs.live.station import serve
from cylforce.programs.run import Daemon, status_line
from cylforce.service.core import Core
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.identified import read_identified, write_identified
from cylforce.settings.machine_file import Loaded

LOOK_S = 0.25
THINK_S = 5.0  # of samples between two judgements
GIVE_UP_S = 30.0  # without one whole sample since the beginning
LIMIT_S = 600.0  # of motion


class Order(NamedTuple):
    """Inputs and outputs of a commissioning.

    bus:        name of the bus
    output:     path of `identified.toml`
    log:        path of the log of the motion
    known_kg:   weight to be lifted afterwards [kg]; None: none
    attachment: tool on the machine
    give_up_s:  time from the beginning without one whole sample, after which it ends [s]
    """

    bus: str
    output: Path
    log: Path
    known_kg: float | None = None
    attachment: str = STANDARD
    give_up_s: float = GIVE_UP_S

    @property
    def lift_log(self) -> Path:
        """The log of the lift: beside the log of the motion, NAME.lift.log."""
        return self.log.with_name(f"{self.log.stem}.lift{self.log.suffix}")


def run_commission(loaded: Loaded, order: Order, console: Console) -> bool:
    """Guide, identify and write; return False when it was interrupted, in which case the log is kept.

    Raises ValueError, RecordingError, BusError or SettingsError with a sentence.
    """
    _check(loaded, order)
    configure_messages(Path(os.devnull).open("w") if sys.stderr.isatty() else sys.stderr)  # noqa: SIM115
    guide = _guide(loaded, order)
    view = _collected(loaded, guide, order, console)
    if not view.advice.done:
        report_stop(loaded, order, view, console)
        return False
    with progress_bar() as watch:
        found = run_identify(loaded, [order.log], order.output, How(attachment=order.attachment), watch)
    show(found, console)
    console.print(Text(f"written: {order.output}{'' if order.known_kg else unbooked(found.tares)}"), soft_wrap=True)
    return order.known_kg is None or _scaled(loaded, found, order, order.known_kg, console)


def _guide(loaded: Loaded, order: Order) -> Guide:
    if order.attachment == STANDARD:
        return Guide(model_of(loaded), every_s=THINK_S)
    if order.known_kg is not None:
        raise RecordingError("--known-kg: the scale is the arm's: lift the known weight with the standard tool")
    common = read_identified(order.output, loaded)
    standard, other = tool_models(loaded, order.attachment, common)
    return Guide(other, THINK_S, attachment_prior(common, standard, other))


def unbooked(tares: Tares) -> str:
    """Return a sentence on the weights that are not booked without a known weight; empty if rated loads are."""
    if tares.scale_error <= GOOD_ENOUGH:
        return _only_degraded(tares)
    return (
        f"; with it no weight above {100.0 * GOOD_ENOUGH / tares.scale_error:.0f} % of the rated payload is booked: "
        f"its pins and bores leave +- {100.0 * tares.scale_error:.1f} % of the weight; lift a known weight "
        "(--known-kg, or identify --lift)"
    )


def _only_degraded(tares: Tares) -> str:
    """Return a sentence on the weights that are degraded because only masses bound the pressures' common scale."""
    if tares.common_error <= GOOD_ENOUGH:
        return ""
    return (
        f"; with it weights above {100.0 * GOOD_ENOUGH / tares.reported_scale_error:.0f} % of the rated payload are "
        f"shown as DEGRADED and booked with +- {100.0 * tares.reported_scale_error:.1f} %: only the data sheet's "
        "masses show the scale of the pressures; lift a known weight (--known-kg, or identify --lift)"
    )


def _check(loaded: Loaded, order: Order) -> None:
    """Check all conditions that would otherwise fail after minutes of motion. Raises RecordingError."""
    if order.log.suffix != ".log":
        raise RecordingError(
            f"{order.log}: the log must end in .log: by that ending `cylforce identify` knows its format"
        )
    check_outputs((order.output, order.log), (loaded.path,), (".toml", ".log"))
    if order.known_kg is not None:
        check_known_kg(order.known_kg, loaded)


def _writer(loaded: Loaded, order: Order, path: Path) -> LogWriter:
    return LogWriter(path, header_of(loaded, None, order.bus), now_us(), order.bus.partition(":")[2])


def _collected(loaded: Loaded, guide: Guide, order: Order, console: Console) -> View:
    """Return the last view of the guidance: enough motion, or interrupted.

    Raises ValueError when the recording is refused, or an error when it is given up.
    """
    bus = open_shared_bus(order.bus)
    try:
        writer = _writer(loaded, order, order.log)
        console.print(f"recording to {order.log}", soft_wrap=True)
        return asyncio.run(_collect(loaded, guide, bus, writer, console, order.give_up_s))
    finally:
        bus.close()


async def _collect(
    loaded: Loaded, guide: Guide, bus: Bus, writer: LogWriter, console: Console, give_up_s: float
) -> View:
    collector, until = Collector(loaded, guide, bus, writer), asyncio.Event()
    with Screen(console) as screen:

        def look() -> None:
            collector.think()
            view = collector.view()
            screen.show(picture(guide, view), summary(guide, view), view.instruction)
            check_outcome(guide, view, give_up_s)
            if view.advice.done:
                until.set()

        try:
            await serve(collector, until, look, LOOK_S)
        finally:
            collector.close()
    if writer.failure:
        raise RecordingError(writer.failure)
    return collector.view()


def check_outcome(guide: Guide, view: View, give_up_s: float = GIVE_UP_S) -> None:
    """Raise ValueError or BusError for a recording that cannot be used.

    ValueError: it is refused, or not enough after a long time. BusError: the sensors have sent nothing.
    """
    if view.advice.refusal is not None:
        raise ValueError(view.advice.refusal)
    if view.deaf_s > give_up_s and view.advice.seconds == 0.0:
        raise BusError(view.instruction)
    if view.advice.seconds > LIMIT_S and not view.advice.done:
        raise ValueError(
            f"after {LIMIT_S / 60:.0f} minutes of motion {known(guide, view)}: check the machine file's tolerances and "
            "the sensors; `cylforce identify` takes the log as it is"
        )


def report_stop(loaded: Loaded, order: Order, view: View, console: Console) -> None:
    """Print that the recording was stopped early, and the command that identifies from its log as it is."""
    tool = "" if order.attachment == STANDARD else f" --attachment {order.attachment}"
    again = f"cylforce identify {loaded.path} {order.log} -o {order.output}{tool}"
    if view.advice.seconds < MIN_SECONDS:
        text = f"stopped after {view.advice.seconds:.0f} s of motion, too few to identify anything; the log is kept"
    else:
        text = f"stopped before it was enough; the log is kept, to identify from it as it is: {again}"
    console.print(Text(text), soft_wrap=True)


def _scaled(loaded: Loaded, found: Identification, order: Order, known_kg: float, console: Console) -> bool:
    """Monitor the lift of a known weight and compute the scale from it; return False when it was interrupted."""
    # The lift determines the scale: its error must not prevent the booking of the known weight. The oil is as
    # warm as it was a minute ago, so that friction and zeros differ no more than between strokes.
    core = Core(loaded.service._replace(adapt=False), found.tares._replace(scale_error=0.0, common_error=0.0))
    console.print(f"recording the lift to {order.lift_log}", soft_wrap=True)
    bus = open_shared_bus(order.bus)
    try:
        writer = _writer(loaded, order, order.lift_log)
        booked = asyncio.run(_lifted(Daemon(loaded, core, bus, writer, NOTHING_KEPT), known_kg, console))
    finally:
        bus.close()
    again = f"cylforce identify {loaded.path} {order.log} -o {order.output}"
    if not booked:
        how = f"with a lift, {again} --lift LIFT.log --known-kg {known_kg:g}"
        console.print(Text(f"stopped before a lift was booked; {order.output} has no scale yet; {how}"), soft_wrap=True)
        return False
    scaled = calibrated(loaded, found, order.lift_log, known_kg)
    write_identified(order.output, scaled, loaded, [(p.name, file_sha256(p)) for p in (order.log, order.lift_log)])
    scale, error = scaled.tares.scale, scaled.tares.scale_error
    console.print(Text(f"scale {scale:.4f} +- {error:.4f}, written: {order.output}"), soft_wrap=True)
    return True


async def _lifted(daemon: Daemon, known_kg: float, console: Console) -> bool:
    """Return whether a weight was booked before the operator stopped."""
    until = asyncio.Event()
    with Screen(console) as screen:

        def look() -> None:
            estimate = daemon.weighing.estimate
            head, say = status_line(estimate, daemon.counts, daemon.bus), _lift_advice(daemon, known_kg)
            screen.show(Text(f"{head}\n\n> {say}", style="bold"), "lift", say)
            if estimate.booking is not None:
                until.set()

        await serve(daemon, until, look, LOOK_S)
    if daemon.log is not None and daemon.log.failure:
        raise RecordingError(daemon.log.failure)
    return daemon.weighing.estimate.booking is not None


def _lift_advice(daemon: Daemon, known_kg: float) -> str:
    if daemon.weighing.pipeline.state is None:
        return f"nothing can be measured: {daemon.weighing.estimate.gross.reason.name.lower().replace('_', ' ')}"
    if daemon.weighing.estimate.booking is not None:
        return "booked: the machine may rest"
    if daemon.weighing.bookings.candidate is None:
        return f"lift {known_kg:g} kg clear of the ground and move it up and down for some seconds"
    return "set it down, and lift the empty tool clear of the ground"
