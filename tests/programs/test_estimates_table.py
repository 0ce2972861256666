"""The table of `replay -o`: words and times that people and plotting programs read."""

import csv
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest

from cylforce.files.shipped import shipped
from cylforce.programs.replay import write_estimates
from cylforce.signals.estimate import Booking, Quantity, Reason, Status, no_estimate

BEGUN = 1_700_000_000_250_000


@pytest.fixture
def rows(tmp_path):
    """A tick without a value, and one 0.5 s later with a weight."""
    nothing = no_estimate(BEGUN, Reason.SIGNAL_STALE, None)
    weighed = no_estimate(BEGUN + 500_000, Reason.STARTING, Booking(7, 0, 1.0, 1.0, 0.0, 1.0, 1.0, 1.0))
    weighed = replace(weighed, gross=Quantity(812.5, 4.0, Status.DEGRADED, Reason.AT_REST))
    path = tmp_path / "estimates.csv"
    write_estimates(path, [nothing, weighed])
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_time_from_the_start_and_as_iso_text(rows):
    assert [row["t_us"] for row in rows] == [str(BEGUN), str(BEGUN + 500_000)]
    assert [float(row["t_s"]) for row in rows] == [0.0, 0.5]
    assert rows[0]["time"] == "2023-11-14T22:13:20.250Z"


def test_status_and_reason_are_words(rows):
    assert [(r["payload_status"], r["payload_reason"]) for r in rows] == [
        ("INVALID", "SIGNAL_STALE"),
        ("DEGRADED", "AT_REST"),
    ]
    assert [r["payload_gross"] for r in rows] == ["", "812.5"]
    assert (rows[1]["soil_x_status"], rows[1]["soil_x_reason"]) == ("INVALID", "STARTING")
    assert not [name for name in rows[0] if name.endswith("_quality")]


def test_the_plotjuggler_layout_names_columns_of_the_table(rows):
    layout = ET.parse(shipped("plotjuggler.xml")).getroot()
    curves = {curve.get("name") for curve in layout.iter("curve")}
    assert curves <= set(rows[0])
    assert len(curves) > 10
    assert layout.find("Plugins/plugin[@ID='DataLoad CSV']/default").get("time_axis") == "t_s"
