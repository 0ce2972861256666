"""A run of the daemon on the real clock, its log, and the replay of that log: the same to the last bit; what has
changed since is told."""

import asyncio
import contextlib
import gc
import io
import json
import re
from itertools import count, pairwise

import numpy as np
import pytest
import structlog
import typer

from cylforce.can.clock import now_us
from cylforce.can.opening import open_bus
from cylforce.commissioning.identification import identify
from cylforce.files.candump import Sent, parsed
from cylforce.files.logfile import LogWriter, file_sha256
from cylforce.files.logreader import log_header, read_events
from cylforce.programs.commands import replay
from cylforce.programs.common.play import prepare
from cylforce.programs.common.readings import header_of, make_core, model_of
from cylforce.programs.live.messages import configure_messages
from cylforce.programs.live.sim_bus import play_until
from cylforce.programs.replay import Totals, run_replay, stream_replay, write_estimates
from cylforce.programs.run import Daemon
from cylforce.programs.sim import run_sim
from cylforce.service.memory import NOTHING_KEPT
from cylforce.service.publication import published
from cylforce.settings.identified import write_identified
from cylforce.settings.machine_file import load
from cylforce.signals.codec import decode
from cylforce.signals.estimate import Estimate, Quantity, Reason, Status, invalid, no_estimate
from cylforce.signals.events import Frame, Tick
from scenarios import EXCAVATOR, moved
from waiting import until

STEPS = 700  # of the daemon that ran
SEED = 3
channels = count()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("replay")


@pytest.fixture(scope="module")
def machine(folder):
    """A machine file of its own, that publishes every step."""
    path = folder / "machine.toml"
    path.write_text(EXCAVATOR.read_text().replace("\nperiod_ms = 50\n", "\nperiod_ms = 10\n"))
    loaded = load(path)
    assert loaded.service.publication[0].period_s == 0.01
    return loaded


@pytest.fixture(scope="module")
def tares(folder, machine):
    """Its identified.toml."""
    path = folder / "identified.toml"
    write_identified(path, identify(model_of(machine), [moved(machine, SEED)]), machine, [])
    return path


def forces(estimates):
    """Return how many estimates have a good force."""
    return sum(e.force.magnitude.status is Status.OK for e in estimates)


def weights(estimates):
    """Return how many estimates have a good weight."""
    return sum(e.gross.status is Status.OK for e in estimates)


@pytest.fixture(scope="module")
def live(folder, machine, tares):
    """The log of a daemon that ran beside simulated sensors until it had enough good estimates, however long a busy
    machine took for that, and what it concluded."""
    name, log = f"virtual:replay{next(channels)}", folder / "live.log"
    estimates = []

    async def main():
        ours, theirs, stop = open_bus(name), open_bus(name), asyncio.Event()
        writer = LogWriter(log, header_of(machine, tares, name), now_us(), "replay")
        daemon = Daemon(machine, make_core(machine, tares), ours, writer, NOTHING_KEPT)
        daemon.on_estimate = estimates.append
        loop = asyncio.get_running_loop()
        daemon.start(loop)
        play = prepare(machine, "cycles", SEED, 0.1, amount=20)
        sensors = asyncio.create_task(play_until(play, theirs, folder / "truth.csv", stop))
        await until(lambda: len(estimates) >= STEPS and forces(estimates) > 100 and weights(estimates))
        stop.set()
        await sensors
        await daemon.stop(loop)
        theirs.close()

    asyncio.run(main())
    return log, estimates


@pytest.fixture(scope="module")
def simulated(folder, machine):
    """A simulated cycle as a log and as a table: as many ticks on every computer, however busy."""
    log, table = folder / "run.log", folder / "run.csv"
    run_sim(machine.path, cycles=1, seed=SEED, log=log, table=table)
    return log, table


def test_every_frame_that_was_sent_comes_out_again(machine, tares, live):
    """All TPDOs that the daemon sent, bit by bit, and every estimate; among them good ones."""
    log, estimates = live
    told = []
    found = run_replay(machine, log, tares, told.append)
    assert (found.different, told) == (0, [])
    assert found.compared > 2 * STEPS
    assert [str(e) for e in found.estimates] == [str(e) for e in estimates]


def test_what_was_sent_is_what_was_concluded(machine, live):
    """The TPDOs in the log, decoded by their layout, are the estimates within the PDOs' resolution."""
    log, estimates = live
    layouts = {pdo.can_id: pdo for pdo in machine.service.publication}
    by_time = {e.t_us: published(e) for e in estimates}
    wanted, seen = None, 0
    for event in read_events(log, 10_000)[1]:
        if isinstance(event, Tick):
            wanted = by_time[event.t_us]
        elif isinstance(event, Sent) and event.can_id in layouts:
            pdo, values = layouts[event.can_id], decode(layouts[event.can_id], event.data)
            for field in pdo.fields:
                np.testing.assert_allclose(values[field.signal], wanted[field.signal], atol=0.5001 * field.scale)
            seen += 1
    assert seen > 1000


def test_the_log_begins_with_its_origin(machine, tares, live):
    """Lines of the pseudo-channel "cylforce" spell the header: the machine file's hash, the tares' hash, versions, the
    starting state; after them events in the order of their ticks."""
    log, _ = live
    lines = log.read_text().splitlines(keepends=True)
    head = [parsed(line) for line in lines if parsed(line).channel == "cylforce"]
    assert [parsed(line) for line in lines[: len(head)]] == head
    said = json.loads(b"".join(line.data for line in head))
    assert said["format"] == 1
    assert said["machine_sha256"] == machine.sha256 == file_sha256(machine.path)
    assert said["identified_sha256"] == file_sha256(tares)
    assert said["state"] == {"zero": 0.0, "tare": 0.0}
    assert {"cylforce", "python", "numpy", "scipy", "processor"} <= said["versions"].keys()
    assert log_header(log).model_dump() == {k: v for k, v in said.items() if k != "format"}
    ticks = [event.t_us for event in read_events(log, 10_000)[1] if isinstance(event, Tick)]
    assert all(b > a and (b - a) % 10_000 == 0 for a, b in pairwise(ticks))


def test_the_sensors_were_commissioned(machine, live):
    """Each sensor node booted, was started, and answered every SYNC from then on."""
    events = list(read_events(live[0], 10_000)[1])
    sync = [e.t_us for e in events if isinstance(e, Sent) and e.can_id == 0x080]
    for node in machine.service.nodes:
        pdos = [e.t_us for e in events if isinstance(e, Frame) and e.can_id == node.pdos[0].can_id]
        asked = [t for t in sync if t >= pdos[0] - 20_000]
        assert abs(len(pdos) - len(asked)) < 0.05 * len(asked)
        assert (Frame, 0x700 + node.node_id) in {(type(e), e.can_id) for e in events if not isinstance(e, Tick)}


def replayed(machine, live, tares):
    told = []
    return run_replay(machine, live[0], tares, told.append), " ".join(told)


def test_a_changed_machine_file_is_told(folder, machine, live):
    """Another mass in the machine file: frames differ, and the sentence names both files."""
    path = folder / "changed.toml"
    path.write_text(machine.text.replace("channel_hz = 5", "channel_hz = 4"))
    found, told = replayed(load(path), live, None)
    assert found.different > 0
    assert "recorded with another machine file" in told
    assert str(machine.path) in told
    assert str(path) in told


@pytest.mark.parametrize(
    ("weights", "said"),
    [
        (((1200.0, 92.0), (1100.0, 60.0), (10.0, 15.0)), r"UNCERTAIN, \+- 60 kg of at most 34 kg: .*--lift"),
        (((100.0, 80.0), (10.0, 50.0)), r"UNCERTAIN, \+- 50 kg of at most 34 kg"),
        (((10.0, 15.0), (160.0, 15.0)), "no load above 170 kg was lifted"),
        (((1200.0, 15.0), (600.0, 60.0)), "the empty tool was not seen in the air"),
        ((), "mostly AT_REST: see the table of reasons"),
    ],
)
def test_why_nothing_was_booked(weights, said):
    """With a rated payload of 3400 kg: an error of 34 kg is enough, a load begins at 170 kg."""
    withheld = [invalid(Reason.STARTING), *[invalid(Reason.AT_REST)] * 2]
    known = [Quantity(value, error, Status.OK, Reason.NONE) for value, error in weights]
    tally = Totals(3400.0)
    for weight in [*withheld, *known]:
        tally.weigh(weight)
    assert re.search(said, tally.unbooked())


def test_other_tares_are_told(folder, machine, live):
    """Without the tares, or with others: told."""
    found, told = replayed(machine, live, None)
    assert found.different > 0
    assert "no identified file" in told
    other = folder / "other.toml"
    write_identified(other, identify(model_of(machine), [moved(machine, SEED + 1)]), machine, [])
    found, told = replayed(machine, live, other)
    assert found.different > 0
    assert f"the identified file of sha256 {file_sha256(other)[:12]}" in told


def test_a_cut_log_replays_as_far_as_it_goes(folder, machine, tares, live):
    """The machine lost power: the last line is cut off, told, all before it is there."""
    text = live[0].read_bytes()
    cut = folder / "cut.log"
    cut.write_bytes(text[: 2 * len(text) // 3])
    found, told = replayed(machine, (cut,), tares)
    assert found.different == 0
    assert found.compared > 1000
    assert "cut off" in told or text[2 * len(text) // 3 - 1] == 10


def test_a_table_gives_the_estimates_of_the_log(machine, tares, simulated):
    """The same simulated run as frames and as a table: the table's samples go through the sensors' PDOs as well, so the
    estimates agree within the resolution of ours; only the place of the ticks between the samples differs."""
    from_log, from_table = (run_replay(machine, path, tares).estimates for path in simulated)
    # the table's first tick, a period after its first row, has seen two rows; so has the log's third, for its samples
    # come after the tick; the log's first ones are marked by boot-up messages
    pairs = list(zip(from_log[2:], from_table, strict=False))[10:]
    assert len(pairs) > 1000
    resolution = {str(f.signal): f.scale for pdo in machine.service.publication for f in pdo.fields}
    resolution |= {"payload_quality": 0.0, "force_quality": 0.0, "booked_count": 0.0}
    one, other = ([published(estimate) for estimate in estimates] for estimates in zip(*pairs, strict=True))
    for name, step in resolution.items():
        logged, tabled = ([float(values[name]) for values in each] for each in (one, other))
        np.testing.assert_allclose(logged, tabled, atol=step, err_msg=name)


def test_estimates_are_written_as_a_table(folder, machine, tares, live):
    """One row a tick, SI values, empty where there is none."""
    path = folder / "estimates.csv"
    estimates = live[1]
    write_estimates(path, estimates)
    head, *rows = path.read_text().splitlines()
    names = head.split(",")
    assert len(rows) == len(estimates)
    for row, estimate in zip(rows, estimates, strict=True):
        cells = dict(zip(names, row.split(","), strict=True))
        assert int(cells["t_us"]) == estimate.t_us
        gross = cells["payload_gross"]
        assert (gross == "") == (estimate.gross.status is Status.INVALID)
        assert gross == "" or float(gross) == estimate.gross.value


def test_a_replay_keeps_nothing_of_what_it_has_told(machine, tares, simulated):
    """Each hundred ticks the estimates that exist are counted: the one told, its predecessor in the state and what
    holds them, no more at the end than at the beginning; kept, they are as many as were told."""
    log, _ = simulated
    alive, told, before = [], 0, living()

    def take(_):
        nonlocal told
        told += 1
        if told % 100 == 0:
            alive.append(living() - before)

    stream_replay(machine, log, tares, take)
    assert told > 1000
    assert max(alive) <= 4
    assert alive[-1] <= alive[0]
    kept = run_replay(machine, log, tares)
    assert living() - before >= len(kept.estimates) == told


def living():
    """How many estimates exist."""
    gc.collect()
    return sum(type(each) is Estimate for each in gc.get_objects())


def test_the_table_is_written_as_the_replay_goes(folder, machine, tares, live, capsys):
    """`replay -o` gives the table of all estimates; what it says counts the same ones."""
    path, whole = folder / "streamed.csv", folder / "whole.csv"
    with contextlib.suppress(typer.Exit):
        replay.replay(machine.path, live[0], tares, path)
    write_estimates(whole, run_replay(machine, live[0], tares).estimates)
    assert path.read_text() == whole.read_text()
    good = sum(e.gross.status is Status.OK for e in live[1])
    assert f"{len(live[1])} steps; weight OK in {100 * good / len(live[1]):.1f} %" in capsys.readouterr().out


def test_a_table_that_cannot_be_finished_leaves_none(folder):
    """What ends in an error half way leaves neither the table nor a part of it."""

    def broken():
        yield no_estimate(0, Reason.STARTING, None)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_estimates(folder / "half.csv", broken())
    assert not list(folder.glob("*half.csv*"))


def test_messages_that_nobody_reads_do_not_stop_the_measurement(machine, tares):
    """The pipe that took the daemon's messages is closed: it goes on concluding, tick by tick."""
    stream = io.StringIO()
    configure_messages(stream)
    stream.close()
    try:
        daemon = Daemon(machine, make_core(machine, tares), open_bus("virtual:unread"), None, NOTHING_KEPT)
        estimates = []
        daemon.on_estimate = estimates.append

        async def main():
            loop = asyncio.get_running_loop()
            daemon.start(loop)
            await until(lambda: len(estimates) > 5)
            await daemon.stop(loop)

        asyncio.run(main())
        assert len(estimates) > 5
    finally:
        structlog.reset_defaults()
