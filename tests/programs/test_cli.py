"""The command line: what users can mend is one sentence and exit code 2, never a traceback; the happy paths."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest

import cylforce
from command_line import cylforce_
from cylforce.can.python_can import Relay
from cylforce.files.tables import read_table
from cylforce.settings.machine_file import load
from scenarios import CONFIG, EXCAVATOR

NO_WAY_OUT = "udp_multicast:239.74.163.2"  # never to be opened: it would leave the machine


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Good and bad files by name."""
    folder = tmp_path_factory.mktemp("cli")
    text = EXCAVATOR.read_text()
    (folder / "folder.log").mkdir()
    for name, content in {
        "copy.toml": text,
        "other.toml": f"{text}# changed\n",
        "broken.toml": "[machine\nname = 1",
        "unknown_key.toml": f"{text}\n[oops]\na = 1\n",
        "no_rod.toml": text.replace("rod_mm = 85\n", "", 1),
        "bad.log": "hello\n",
        "empty.log": "",
        "empty.toml": "",
        "identified.toml": "[provenance]\nformat = 1\n",
        "foreign.log": "(1700000000.000000) can0 1FF#0102\n",
        "lacking.csv": "t_s,boom_head_pressure\n0,1e5\n0.01,2e5\n",
        "words.csv": "t_s,boom_head_pressure\n0,one\n",
        "own.py": "class Squeak(:\n",
        "effects.toml": '[[effects]]\nname = "glue"\nat = "boom"\nvalue = 1.0\n',
        "effects2.toml": '[[effects]]\nname = "coulomb_friction"\nat = "boom"\nvalue = 1.0\n'
        '[[effects]]\nname = "leak"\nat = "boom"\nvalue = 1.0\nform_s = 1\n',
        "junk.blf": "junk",
        "junk.asc": "junk",
        "junk.parquet": "junk",
        "notes.txt": "junk",
        "late.csv": stamped([0.01 * k for k in range(10)] + [1e6, 1e6 + 0.01]),
        "long.csv": stamped([3600.0 * k for k in range(40)]),
    }.items():
        (folder / name).write_text(content)
    (folder / "binary.toml").write_bytes(b"\xff\xfe\x00")
    os.mkfifo(folder / "pipe.toml")
    os.mkfifo(folder / "pipe.log")
    for name in ("huge.toml", "endless.log", "endless.csv"):
        (folder / name).write_text("a" * (11_000_000 if name == "huge.toml" else 2_000_000))
    return folder


def stamped(times):
    """A table of the excavator's signals, all 0, at these times [s]."""
    names = [signal.name for signal in load(EXCAVATOR).service.machine.signals]
    rows = (",".join([f"{t}", *("0" for _ in names)]) for t in times)
    return "\n".join([",".join(["t_s", *names]), *rows]) + "\n"


@pytest.fixture(scope="module")
def runs(files):
    """Moves of the empty machine and a cycle, simulated by the command line itself."""
    cylforce_("sim", EXCAVATOR, "--scenario", "moves", "--duration", 60, "--seed", 3, "--log", files / "moves.log")
    cylforce_("sim", EXCAVATOR, "--cycles", 1, "--seed", 3, "--log", files / "run.log", "--table", files / "run.csv")
    cylforce_("sim", files / "other.toml", "--cycles", 1, "--seed", 3, "--log", files / "other.log")
    return files


@pytest.fixture(scope="module")
def relay():
    with Relay() as running:
        yield running.name


# "@" stands for the folder of files, "M" for the machine file, "RELAY" for a bus that can be opened.
MENDABLE = [
    ("run @/absent.toml --bus virtual:a", r"absent\.toml: cannot be read"),
    ("run @/broken.toml --bus virtual:a", r"broken\.toml:1: .* is not TOML"),
    ("run @/unknown_key.toml --bus virtual:a", r"unknown_key\.toml:\d+: oops is not a key"),
    ("run @/no_rod.toml --bus virtual:a", r"no_rod\.toml:\d+: cylinders\.boom"),
    ("run @ --bus virtual:a", "cannot be read"),
    ("describe @/pipe.toml", r"pipe\.toml: is no ordinary file"),
    ("describe /dev/zero", r"/dev/zero: is no ordinary file"),
    ("describe M --svg @/pipe.log", r"pipe\.log: is no ordinary file"),
    ("identify @/pipe.log -o @/o.toml", r"pipe\.log: is no ordinary file"),
    ("replay M @/pipe.log", r"pipe\.log: is no ordinary file"),
    ("replay M @/run.log --identified @/pipe.toml", r"pipe\.toml: is no ordinary file"),
    ("gap M @/pipe.log", r"pipe\.log: is no ordinary file"),
    ("checkup M @/pipe.log", r"pipe\.log: is no ordinary file"),
    ("checkup M", "no recording to check: give one or more, or --bus"),
    ("checkup M @/run.log --next-motion @/moves.log", r"moves\.log: exists and is no \.csv file"),
    ("sim M --motion @/pipe.toml --table @/played.csv", r"pipe\.toml: is no ordinary file"),
    ("sim M --motion @/absent.csv --table @/played.csv", r"absent\.csv: cannot be read"),
    ("sim M --effects @/pipe.toml", r"pipe\.toml: is no ordinary file"),
    ("describe @/huge.toml", r"huge\.toml: is larger than 10 MB"),
    ("replay M @/run.log --identified @/huge.toml", r"huge\.toml: is larger than 10 MB"),
    ("sim M --effects @/huge.toml", r"huge\.toml: is larger than 10 MB"),
    ("replay M @/endless.log", r"endless\.log, line 1: longer than 1000000 characters"),
    ("identify M @/endless.csv -o @/o.toml", r"endless\.csv, line 1: longer than 1000000 characters"),
    ("gap M @/endless.csv", r"endless\.csv, line 1: longer than 1000000 characters"),
    (
        "identify M @/late.csv -o @/o.toml",
        r"late\.csv, line 12: time leaps by 1e\+06 s, more than 3600 s: a wrong stamp",
    ),
    ("replay M @/late.csv", r"late\.csv, line 12: time leaps by 1e\+06 s, .* correct it, or split the file there"),
    ("gap M @/late.csv", r"late\.csv, line 12: time leaps"),
    ("identify M @/long.csv -o @/o.toml", r"long\.csv, line 30: 100800 s after the first row, more than 100000 s"),
    ("run M --bus RELAY --records @/pipe.log", r"pipe\.log: is no ordinary file"),
    ("run M --bus RELAY --lock-file @/pipe.log", r"--lock-file .*pipe\.log: is no small text file"),
    ("run M --bus RELAY --lock-file /dev/zero", r"--lock-file /dev/zero: is no small text file"),
    ("run M --bus RELAY --log @/pipe.log", r"--log .*pipe\.log: is no ordinary file"),
    ("run M --bus RELAY --identified /dev/zero", r"/dev/zero: is no ordinary file"),
    ("records audit @/pipe.log", r"pipe\.log: there are no records"),
    ("seal M @/pipe.toml --reason x", r"pipe\.toml: is no ordinary file"),
    (
        "display M --bus RELAY --listen 0.0.0.0:1 --pin-file @/pipe.log",
        r"--pin-file .*pipe\.log: is no small text file",
    ),
    ("describe M --svg @/run.log", r"run\.log: exists and is no \.svg file, so it is kept"),
    ("describe M --eds @/run.csv", r"run\.csv: exists and is no \.eds file"),
    ("replay M @/run.csv -o @/moves.log", r"moves\.log: exists and is no \.csv file"),
    ("identify M @/run.log -o @/moves.log", r"moves\.log: exists and is no \.toml file"),
    ("gap M @/run.log --html @/moves.log", r"moves\.log: exists and is no \.html file"),
    ("commission M --bus remote:127.0.0.1:1 -o @/run.csv", r"run\.csv: exists and is no \.toml file"),
    ("sim M --cycles 1 --log @/run.log", r"--log .*run\.log: exists and is not replaced"),
    ("sim M --cycles 1 --table @/run.csv", r"--table .*run\.csv: exists and is not replaced"),
    ("sim M --cycles 1 --truth @/run.log", r"run\.log: exists and is no \.csv file"),
    ("run M --bus vcan0", "has no channel"),
    ("run M --bus virtual:", "has no channel"),
    ("run M --bus :", "has no channel"),
    ("run M --bus kvaser:0", "there is no interface 'kvaser'"),
    (f"run M --bus {NO_WAY_OUT}", "would send frames out of this machine"),
    ("run M --bus remote:10.0.0.1:54701", "frames stay on this machine"),
    ("run M --bus remote:127.0.0.1:1", r"no relay answers .*start `python -m can_remote -i virtual -c x -p 1 -H 127"),
    ("run M --bus remote:127.0.0.1:0", "'0' is no port number: write one from 1 to 65535"),
    ("run M --bus remote:127.0.0.1:65536", "'65536' is no port number"),
    ("run M --bus remote:127.0.0.1:" + "9" * 5000, "is no port number"),
    ("run M --bus socketcan:absent0", "socketcan:absent0: "),
    ("run M --bus virtual:a --identified @/absent.toml", r"run `cylforce identify` first"),
    ("run M --bus virtual:a --identified M", r"is a machine file, not the file that `cylforce identify` writes"),
    ("run M --bus virtual:a --identified @/effects.toml", r"is TOML, not the file that `cylforce identify` writes"),
    ("run M --bus virtual:a --identified @/empty.toml", r"empty\.toml: is empty; run `cylforce identify`"),
    ("describe @/identified.toml", r"identified\.toml: is no machine file but one of `cylforce identify`"),
    ("replay @/identified.toml @/run.log", r"identified\.toml: is no machine file"),
    ("commission @/broken.toml --bus virtual:a -o @/o.toml", r"broken\.toml:1: .* is not TOML"),
    ("run M --bus remote:127.0.0.1:1 --log @/a.txt", r"--log .*a\.txt: must end in \.log"),
    ("fleet @/recordings -o @/table.csv", r"table\.csv: the table must end in \.parquet"),
    ("config copy absent.toml", r"'absent\.toml' is not shipped with cylforce: choose one of excavator_20t\.toml"),
    ("config copy cylforce.eds -o @/absent", r"absent: is not a folder"),
    ("config copy copy.toml -o @", "is not shipped"),
    ("commission M --bus vcan0 -o @/o.toml", "has no channel"),
    (f"commission M --bus {NO_WAY_OUT} -o @/o.toml", "would send frames out of this machine"),
    ("commission M --bus virtual:a -o @/absent/o.toml", r"o\.toml: cannot be written: choose a file in a folder"),
    ("commission M --bus virtual:a -o @", "cannot be written: choose a file"),
    ("commission M --bus virtual:a -o @/o.toml --log @/absent/o.log", r"o\.log: cannot be written"),
    ("commission M --bus virtual:a -o @/o.toml --log @/o.csv", r"o\.csv: the log must end in \.log"),
    ("commission M --bus virtual:a -o @/o.toml --known-kg 0", "--known-kg 0: .*lift 75 to 3000 kg"),
    ("commission M --bus virtual:a -o @/o.toml --known-kg 3001", "--known-kg 3001: .*lift 75 to 3000 kg"),
    ("identify M -o @/o.toml", "name a recording of the empty machine after it"),
    ("identify M @/absent.log -o @/o.toml", r"absent\.log: does not exist"),
    ("identify @/foreign.log -o @/o.toml", "does not say which machine it is of"),
    ("identify M @/foreign.log -o @/o.toml", "no gapless stretch"),
    ("identify M @/lacking.csv -o @/o.toml", r"lacking\.csv: has no column .*boom_rod_pressure"),
    ("identify M @/bad.log -o @/o.toml", r"bad\.log, line 1"),
    ("identify M @/empty.log -o @/o.toml", r"empty\.log: holds no frame"),
    ("identify M @/folder.log -o @/o.toml", r"folder\.log: cannot be read"),
    ("identify M @/junk.blf -o @/o.toml", r"junk\.blf: "),
    ("identify M @/junk.asc -o @/o.toml", r"junk\.asc: "),
    ("identify M @/junk.parquet -o @/o.toml", r"junk\.parquet: is no Parquet file"),
    ("identify M @/notes.txt -o @/o.toml", "is none of the recordings"),
    ("identify M @/moves.log -o @/absent/o.toml", r"o\.toml: cannot be written"),
    ("identify M @/moves.log -o @/o.toml --report @/absent/r.html", r"r\.html: cannot be written"),
    ("identify M @/run.log -o @/moves.log @/moves.log", r"moves\.log: would replace another file"),
    ("identify @/copy.toml @/moves.log -o @/copy.toml", r"copy\.toml: would replace another file"),
    ("identify M M @/moves.log -o @/o.toml", "a machine file is named once, before the recordings"),
    ("identify M @/moves.log -o @/o.toml --known-kg 500", "go together"),
    ("identify M @/moves.log -o @/o.toml --known-kg 500 --lift @/moves.log", "no lift of 500 kg is seen"),
    ("identify M @/moves.log -o @/o.toml --known-kg nan --lift @/moves.log", "--known-kg nan: .*lift 75 to 3000 kg"),
    ("identify M @/moves.log -o @/o.toml --known-kg inf --lift @/moves.log", "--known-kg inf: .*lift 75 to 3000 kg"),
    ("identify M @/moves.log -o @/o.toml --known-kg 0 --lift @/moves.log", "--known-kg 0: .*lift 75 to 3000 kg"),
    ("replay M @/absent.log", r"absent\.log: does not exist"),
    ("replay @/other.toml @/run.log", r"run\.log: was recorded with machine file .*20t\.toml, not with .*other\.toml"),
    ("replay @/other.toml @/run.log --bus virtual:a", r"run\.log: was recorded with machine file"),
    ("identify @/other.toml @/moves.log -o @/o.toml", r"moves\.log: was recorded with machine file"),
    ("identify M @/moves.log --lift @/other.log --known-kg 500 -o @/o.toml", r"other\.log: was recorded with machine"),
    ("identify M @/moves.log @/moves.log -o @/o.toml", r"moves\.log: is named twice"),
    ("run M --bus virtual:a --log @/a.log --log-size nan", "give 1 to 100000 MB"),
    ("run M --bus virtual:a --log @/a.log --log-size 1e400", r"--log-size inf: .*give 1 to 100000 MB"),
    ("replay M @/bad.log", r"bad\.log, line 1"),
    ("replay M @/lacking.csv", r"lacking\.csv: has no column"),
    ("replay M @/words.csv", r"words\.csv"),
    ("replay M @/run.log --identified @/broken.toml", r"broken\.toml: is not TOML"),
    ("replay M @/run.log -o @/absent/e.csv", r"e\.csv: cannot be written"),
    ("replay M @/run.csv -o @/run.csv", r"run\.csv: would replace another file"),
    ("replay M @/run.log --bus nonsense", "has no channel"),
    (f"replay M @/run.log --bus {NO_WAY_OUT}", "would send frames out of this machine"),
    ("replay M @/absent.log --bus RELAY", r"absent\.log: does not exist"),
    ("replay M @/lacking.csv --bus RELAY", r"lacking\.csv: has no column"),
    ("sim M --scenario dance", "choose moves or cycles"),
    ("sim @/broken.toml", r"broken\.toml:1: .* is not TOML"),
    ("sim M --mass-error nan", "is not a fraction"),
    ("sim M --scenario moves --duration nan", "--duration nan: .*give 10 to 36000 s"),
    ("sim M --scenario moves --duration 1e400 --log @/t.log", "--duration inf: .*give 10 to 36000 s"),
    ("sim M --cycles 10001 --log @/t.log", "--cycles 10001: .*give 1 to 10000"),
    ("sim M --scenario moves --payload-kg 3001 --log @/t.log", "--payload-kg 3001: .*give 0 to 3000 kg"),
    ("sim M --scenario moves --payload-kg nan --log @/t.log", "--payload-kg nan: .*give 0 to 3000 kg"),
    ("sim M", "this run would write nothing: give --bus"),
    ("sim M --cycles 1 --table @/t.txt", r"t\.txt: must end in \.csv or \.parquet"),
    ("sim M --cycles 1 --log @/t.log --truth @/t.log", r"t\.log: would replace another file"),
    ("sim M --cycles 1 --truth @/t.csv --log @/absent/t.log", r"absent/t\.log: cannot be written"),
    ("sim M --effects @/absent.toml", r"absent\.toml: cannot be read \(No such file or directory\)"),
    ("sim M --effects @/effects.toml", r"effects\.toml:1: effect 'glue' is not known: choose one of"),
    ("sim M --effects @/effects2.toml", r"effects2\.toml:9: effects\.leak\.form_s is not a key.*did you mean from_s"),
    ("sim M --library @/own.py", r"own\.py:1: is no Python"),
    ("sim M --library @/absent.py", r"absent\.py: cannot be read \(No such file or directory\)"),
    ("sim M --effects @/binary.toml", r"binary\.toml: is not UTF-8 text"),
    ("sim M --effects @/broken.toml", r"broken\.toml: is not TOML"),
    ("sim M --effects @/empty.toml", r"empty\.toml:1: the file lacks the key effects: add it"),
    ("sim M --cycles 1 --truth @/absent/t.csv", r"t\.csv: cannot be written"),
    ("sim M --cycles 1 --log @/absent/t.log", r"t\.log: cannot be written"),
    ("sim M --cycles 1 --table @/absent/t.csv", r"t\.csv: cannot be written"),
    (f"sim M --bus {NO_WAY_OUT}", "would send frames out of this machine"),
    ("run M --bus virtual:a", r"virtual:a: exists inside one process only"),
    ("sim M --bus virtual:a", r"virtual:a: exists inside one process only"),
    ("replay M @/run.log --bus virtual:a", r"virtual:a: exists inside one process only"),
    ("commission M --bus virtual:a -o @/o.toml", r"virtual:a: exists inside one process only"),
    ("sim M --bus remote:127.0.0.1:1", "no relay answers"),
    ("commission M --bus remote:127.0.0.1:1 -o @/o.toml", "no relay answers"),
    ("demo --bus remote:127.0.0.1:1", "no relay answers"),
    ("demo --bus nonsense", "has no channel"),
    ("demo --json @", "cannot be written"),
    ("demo --json @/run.log", r"run\.log: exists and is no \.json file"),
    ("demo --machine @/absent.toml", r"absent\.toml: cannot be read"),
    ("describe @/no_rod.toml", r"no_rod\.toml:\d+: cylinders\.boom"),
    ("describe M --eds @/absent/a.eds", r"a\.eds: cannot be written"),
    ("describe M --dbc @", "cannot be written"),
    (f"describe M --eds @/{'a' * 250}.eds", r"\.eds: cannot be written \(File name too long\)"),
    (f"sim M --cycles 1 --truth @/{'a' * 250}.csv", r"\.csv: cannot be written \(File name too long\)"),
    ("describe @/copy.toml --eds @/copy.toml", "would replace another file"),
]


@pytest.mark.parametrize(("words", "told"), MENDABLE, ids=[words for words, _ in MENDABLE])
def test_what_users_can_mend_is_one_sentence(runs, relay, capsys, words, told):
    """One line on standard error that names what is wrong, exit code 2; no file is left half written."""
    before = sorted(runs.iterdir())
    line = words.replace("@", str(runs)).replace(" M", f" {EXCAVATOR}").replace("RELAY", relay)
    assert cylforce_(*line.split()) == 2
    said = capsys.readouterr()
    assert said.err.startswith("cylforce: ")
    assert said.err.count("\n") == 1
    assert said.out == ""
    assert re.search(told, said.err), said.err
    assert sorted(runs.iterdir()) == before


@pytest.mark.parametrize("words", ["run", "nonsense", "describe", f"run {EXCAVATOR}", "sim x --cycles 0"])
def test_wrong_usage_is_told(capsys, words):
    """Missing and unknown arguments: how it is used, exit code 2."""
    assert cylforce_(*words.split()) == 2
    assert "Usage: " in capsys.readouterr().err


def test_version_and_help(capsys):
    assert cylforce_("--version") == 0
    assert capsys.readouterr().out == f"cylforce {cylforce.__version__}\n"
    assert cylforce_("--help") == 0
    out = capsys.readouterr().out
    for command in ("run", "identify", "commission", "replay", "sim", "demo", "describe"):
        assert command in out


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.toml")), ids=lambda path: path.stem)
def test_describe(capsys, tmp_path, path):
    """What the machine file says, and the EDS and DBC as they are shipped for it."""
    assert cylforce_("describe", path, "--eds", tmp_path / "a.eds", "--dbc", tmp_path / "a.dbc") == 0
    out = capsys.readouterr().out
    machine = load(path).service.machine
    assert machine.name in out
    assert all(link.name in out for link in machine.links)
    assert "payload_gross" in out
    assert "[DeviceInfo]" in (tmp_path / "a.eds").read_text()
    assert "BO_ " in (tmp_path / "a.dbc").read_text()


def test_identify_and_replay(capsys, runs, tmp_path):
    """Our own log names its machine file; the tares go into a replay, whose estimates go into a table."""
    tares, table = tmp_path / "identified.toml", tmp_path / "estimates.csv"
    assert cylforce_("identify", runs / "moves.log", "-o", tares) == 0
    assert "boom.X" in capsys.readouterr().out
    assert tares.with_suffix(".statistics.npz").exists()
    assert cylforce_("replay", EXCAVATOR, runs / "run.log", "--identified", tares, "-o", table) == 0
    out = capsys.readouterr().out
    assert "weight OK in" in out
    found = read_table_of(table)
    assert np.sum(np.isfinite(found[:, 1])) > 100
    assert cylforce_("replay", EXCAVATOR, runs / "run.csv", "--identified", tares) == 0


def read_table_of(path):
    """Time and gross weight of an estimates table."""
    lines = path.read_text().splitlines()
    at = [lines[0].split(",").index(name) for name in ("t_us", "payload_gross")]
    return np.array([[float(row.split(",")[k] or "nan") for k in at] for row in lines[1:]])


def test_a_simulated_table_has_all_signals(runs):
    names = [s.name for s in load(EXCAVATOR).service.machine.signals]
    assert np.all(np.isfinite(read_table(runs / "run.csv", names).values))


def test_as_a_module():
    """`python -m cylforce` is the same command."""
    done = subprocess.run(
        [sys.executable, "-m", "cylforce", "run", "absent.toml", "--bus", "virtual:a"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("cylforce: absent.toml: cannot be read")
    assert done.stderr.count("\n") == 1


def test_the_package_runs_as_the_command():
    done = subprocess.run([sys.executable, "-m", "cylforce", "--help"], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert "gap" in done.stdout


def test_a_log_whose_machine_file_is_gone_says_which_it_names(tmp_path, capsys):
    machine, log = tmp_path / "digger.toml", tmp_path / "moves.log"
    machine.write_text(EXCAVATOR.read_text())
    assert cylforce_("sim", machine, "--cycles", 1, "--seed", 3, "--log", log) == 0
    machine.unlink()
    assert cylforce_("identify", log, "-o", tmp_path / "o.toml") == 2
    assert re.search(r"moves\.log: names the machine file .*digger\.toml, which is not there", capsys.readouterr().err)
