"""The crane's machine file, written from its own parameters: the dogbones agree with the authors' own curves."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cylforce.estimation.channels import Channels
from cylforce.files.tables import read_table
from cylforce.settings.machine_file import load
from cylforce.signals.units import DEGREE

TOOLS = Path(__file__).resolve().parents[2] / "tools"
CURVES = ("p_m_stroke_to_angle", "p_k_stroke_to_angle")


def write(folder, output):
    command = [sys.executable, "-m", "crane", folder, "-o", output]
    return subprocess.run(command, cwd=TOOLS, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def data(shared):
    return shared / "data" / "hmf_crane"


@pytest.fixture(scope="module")
def loaded(data, tmp_path_factory):
    output = tmp_path_factory.mktemp("crane") / "crane.toml"
    done = write(data, output)
    assert done.returncode == 0, done.stderr
    return load(output)


@pytest.mark.parametrize(("joint", "limit_deg"), [(0, 0.05), (1, 0.5)])
def test_dogbone_gives_the_angle_of_the_authors_curve(loaded, data, joint, limit_deg, capsys):
    """Over 10-95 % of the stroke, where the recordings are. The curves are polynomials of degree 9 that the authors
    fitted to their own model; what remains for the jib is their ripple (several periods over the stroke). The only
    number taken from them is the cylinder's length at stroke 0."""
    machine = loaded.service.machine
    curve = json.loads((data / "stroke_to_angle_poly.json").read_text())[CURVES[joint]]
    cylinder = machine.cylinders[joint]
    stroke = np.linspace(0.1, 0.95, 851) * (cylinder.length_high - cylinder.length_low)
    parameters = json.loads((data / "model_parameters.json").read_text())
    tilt = np.arctan2(float(parameters["zeta_C"]), float(parameters["eta_C"]))
    found = machine.joint_angle(joint, cylinder.length_low + stroke) - (tilt, -tilt)[joint]
    off = (found - np.polyval(curve, stroke)) / DEGREE
    worst, rms = np.abs(off).max(), np.sqrt(np.mean(off**2))
    with capsys.disabled():
        print(f"\n{machine.links[joint].name}: within {worst:.3f} deg of the authors' curve, rms {rms:.3f} deg")
    assert worst < limit_deg


def test_every_run_is_within_the_machine(loaded, data):
    """All samples of all runs are read by the file's own mapping, lie in range and have an angle."""
    machine = loaded.service.machine
    channels = Channels(machine, loaded.service.filters)
    runs = sorted(data.glob("*_230425.csv"))
    assert len(runs) == 5
    for run in runs:
        table = read_table(run, [signal.name for signal in machine.signals], loaded.columns)
        low, high = np.array([[s.low, s.high] for s in machine.signals]).T
        assert np.all((table.values > low) & (table.values < high))
        assert np.all(np.isfinite(channels.read(table.values)))


def test_bus_carries_the_digits_of_the_recording(loaded, data):
    """Each PDO's digit is as fine as the recording's last one, so that playing it onto a bus loses nothing."""
    digit = {f.signal: f.scale for node in loaded.service.nodes for pdo in node.pdos for f in pdo.fields}
    with (data / "Dual1SineRun_230425.csv").open() as file:
        rows = list(csv.DictReader(file))
    for column in loaded.columns.columns:
        cells = np.array([float(row[column.column]) for row in rows]) * column.scale / digit[column.signal]
        assert np.abs(cells - np.round(cells)).max() < 0.51


def test_its_machine_file_brings_no_warning(loaded):
    assert loaded.warnings == ()


def test_a_folder_without_parameters_is_refused_with_a_sentence(tmp_path):
    done = write(tmp_path, tmp_path / "crane.toml")
    assert done.returncode == 2
    assert done.stderr.startswith("hmf_crane: ")
    assert "model_parameters.json" in done.stderr
    assert not (tmp_path / "crane.toml").exists()


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        ({"zeta_C": "eta_C", "eta_C": "zeta_C"}, "refers to itself"),
        ({"eta_C": "__import__('os').getcwd()", "zeta_C": "0"}, "beyond what is evaluated"),
        ({"eta_C": "2 +", "zeta_C": "0"}, "is no expression"),
        ({"zeta_C": "0"}, "eta_C is missing"),
    ],
)
def test_expressions_are_evaluated_and_never_run(tmp_path, texts, said):
    (tmp_path / "model_parameters.json").write_text(json.dumps(texts))
    (tmp_path / "stroke_to_angle_poly.json").write_text("{}")
    done = write(tmp_path, tmp_path / "crane.toml")
    assert done.returncode == 2
    assert said in done.stderr
