"""`cylforce sim`: the simulated excavator, into files faster than real time or onto a bus as its sensors."""

import secrets
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from itertools import islice
from pathlib import Path

import numpy as np

from cylforce.effects.library import LIBRARY
from cylforce.files.atomic import check_outputs, replacing
from cylforce.files.candump import event_lines
from cylforce.files.logfile import BLOCK_LINES, Header, header_lines, running_versions
from cylforce.files.tables import SUFFIXES, Table, write_table
from cylforce.files.truth import TruthWriter, truth_columns
from cylforce.mechanics.installation import STANDARD
from cylforce.programs.common.machine_file import load_machine
from cylforce.programs.common.play import Play, prepare
from cylforce.programs.common.user_library import load_library
from cylforce.programs.live.sim_bus import play_on_bus
from cylforce.settings.machine_file import SettingsError
from cylforce.signals.estimate import Array
from cylforce.simulation.sensing import Record
from cylforce.simulation.sensor_bus import bus_events

SCENARIOS = ("moves", "cycles")
START_US = 1_767_225_600_000_000  # 2026-01-01: one seed gives one file, whenever it is written


def run_sim(
    machine_file: Path,
    *,
    scenario: str = "cycles",
    cycles: int = 3,
    duration: float = 120.0,
    seed: int | None = None,
    mass_error: float = 0.1,
    effects: Path | None = None,
    library: Path | None = None,
    motion: Path | None = None,
    payload: float = 0.0,
    turning: bool = False,
    attachment: str = STANDARD,
    truth: Path | None = None,
    bus: str | None = None,
    log: Path | None = None,
    table: Path | None = None,
) -> int:
    """Simulate the machine of a machine file; returns the seed, which is also printed.

    Parameters
    ----------
    machine_file
        The machine file (TOML); the simulated machine's masses are off from it by the fraction `mass_error`.
    scenario
        "moves": commissioning moves for `duration` [s]. "cycles": `cycles` digging cycles of at most 15
        s.
    seed
        One seed is one machine, whatever the scenario, and one run; None draws one.
    effects
        A TOML file of effects of the diagnosis' library (`effects/library.py`): tables `[[effects]]` with `name`,
        `at` (a cylinder, a sensor, a link or "machine"), `value` (SI; a list where the effect has several sizes) and,
        if need be, `shape` (a table of its other parameters), `from_s` and `until_s`.
    library
        A Python file with effects of the user's own, which the file of effects may name as well (see
        `common/user_library.py`).
    motion
        A table of joint angles over time (see `files/motion_table.py`) that is played in place of a scenario.
    payload, turning
        The moves with so much in the bucket [kg], with the house turning to and fro.
    attachment
        The tool on the machine.
    truth
        Where the truth goes (CSV after one line of JSON), never to be read by the daemon.
    bus
        "INTERFACE:CHANNEL": be the sensors on this bus, on the real clock, until the run is over.
    log, table
        Without a bus: the events (candump text) that the daemon would see, the samples (CSV or Parquet, SI
        units).

    Raises
    ------
    SettingsError, RecordingError, BusError, ValueError
        One sentence each.
    """
    _check(scenario, cycles, duration, mass_error)
    _check_moves("moves" if motion else scenario, payload, turning and motion is None)
    check_outputs((truth, log, table), (machine_file, effects, library, motion), (".csv", "", ""))
    seed = secrets.randbits(32) if seed is None else seed
    loaded = load_machine(machine_file)
    loaded = loaded._replace(service=loaded.service.fitted(attachment))
    _check_payload(payload, loaded.service.machine.rated_payload)
    play = prepare(
        loaded,
        scenario,
        seed,
        mass_error,
        amount=cycles if scenario == "cycles" else duration,
        effects=effects,
        library=LIBRARY if library is None else (*LIBRARY, *load_library(library, loaded.service.machine)),
        payload=payload,
        turning=turning,
        motion=motion,
    )
    _check_wanted(bus, truth, log, table)
    if bus is not None:
        play_on_bus(play, bus, truth)
    else:
        print(f"seed {seed}", flush=True)
        write_files(play, truth, log, table)
    return seed


def _check(scenario: str, cycles: int, duration: float, mass_error: float) -> None:
    if scenario not in SCENARIOS:
        raise SettingsError(f"there is no scenario {scenario!r}: choose moves or cycles")
    if scenario == "cycles" and not 1 <= cycles <= 10_000:
        raise SettingsError(f"--cycles {cycles}: cannot be simulated: give 1 to 10000")
    if scenario == "moves" and not 10.0 <= duration <= 36_000.0:
        raise SettingsError(f"--duration {duration:g}: moves of this length cannot be simulated: give 10 to 36000 s")
    if not 0.0 <= mass_error <= 0.5:
        raise SettingsError(f"a mass error of {mass_error} is not a fraction from 0 to 0.5")


def _check_moves(scenario: str, payload: float, turning: bool) -> None:
    if scenario != "moves" and (payload or turning):
        raise SettingsError("a payload and turning belong to the scenario moves: cycles dig their own load and swing")


def _check_payload(payload: float, rated: float) -> None:
    if not 0.0 <= payload <= 2.0 * rated:
        raise SettingsError(
            f"--payload-kg {payload:g}: cannot be carried: give 0 to {2.0 * rated:g} kg, twice the rated payload"
        )


def _check_wanted(bus: str | None, truth: Path | None, log: Path | None, table: Path | None) -> None:
    if bus is None and truth is log is table is None:
        raise SettingsError("this run would write nothing: give --bus, or files to write (--log, --table, --truth)")
    for option, path, suffixes in (("--log", log, (".log",)), ("--table", table, SUFFIXES)):
        if path is not None and path.suffix.lower() not in suffixes:
            raise SettingsError(
                f"{option} {path}: must end in {' or '.join(suffixes)}: by that ending it is read again"
            )
        if path is not None and path.exists():
            raise SettingsError(f"{option} {path}: exists and is not replaced: choose another file, or remove it first")


def write_files(play: Play, truth: Path | None, log: Path | None, table: Path | None) -> None:
    """The run into files, faster than real time, part by part."""
    parts: list[tuple[Array, Array]] = []
    with ExitStack() as files:
        records = play.records
        if truth is not None:
            records = _with_truth(play, records, truth, files)
        if table is not None:
            records = _remembered(records, parts)
        if log is not None:
            write_log(play, records, log)
        for _ in records:
            pass
    if table is not None:
        t, values = (np.concatenate(each) for each in zip(*parts, strict=True))
        write_table(table, Table(t, values, tuple(signal.name for signal in play.service.machine.signals)))


def _with_truth(play: Play, records: Iterable[Record], path: Path, files: ExitStack) -> Iterator[Record]:
    """The records as they come, each after its truth was written."""
    writer: TruthWriter | None = None
    for record in records:
        names, rows = truth_columns(play.service.machine, record)
        if writer is None:
            whole = files.enter_context(replacing(path))
            writer = files.enter_context(TruthWriter(whole, play.header, names))
        writer.write(times_us(record), rows)
        yield record


def _remembered(records: Iterable[Record], parts: list[tuple[Array, Array]]) -> Iterator[Record]:
    """The records as they come; `parts` receives their times and values."""
    for record in records:
        parts.append((record.t, record.values))
        yield record


def times_us(record: Record) -> list[int]:
    """When a record's samples are taken [us]: at the SYNC that goes out with the tick."""
    return [START_US + round(1e6 * t) for t in record.t.tolist()]


def write_log(play: Play, records: Iterable[Record], path: Path) -> None:
    """The events of the run as the daemon would have logged them."""
    events = bus_events(play.service, play.made, records, START_US, np.random.default_rng((play.seed, 3)))
    with replacing(path) as temporary, temporary.open("w", encoding="ascii", newline="\n") as file:
        file.write(header_lines(header(play), START_US))
        for some in iter(lambda: list(islice(events, BLOCK_LINES)), []):
            file.write(event_lines(some, "can0"))


def header(play: Play) -> Header:
    """What the log of a simulated run begins with: nothing zeroed, nothing identified."""
    return Header(
        versions=running_versions(),
        machine=str(play.loaded.path),
        machine_sha256=play.loaded.sha256,
        identified_sha256=None,
        state={"zero": 0.0, "tare": 0.0},
        bus="simulated",
        node_id=play.service.node_id,
    )
