"""The operator's page as text, and what the page advises."""

from dataclasses import replace

import pytest

from cylforce.display.listener import Listener
from cylforce.display.panel import Loading, TruckState
from cylforce.display.picture import Marks, Painter
from cylforce.display.terminal import WIDTH, lines
from cylforce.display.words import languages
from cylforce.signals.estimate import Reason, no_estimate
from cylforce.signals.events import Frame
from cylforce.signals.units import MASS_UNITS
from published import NOW, SERVICE, WEIGHT, heard, weighed


def loading(total=4000.0, filled=4, target=5000.0):
    made = Loading()
    made.update(TruckState(3, total - 900.0, filled - 1, filled - 1, 0, 0, target, 0))
    made.update(TruckState(3, total, filled, filled, 0, 0, target, 0))
    return made


def shown(estimate, made, language="en"):
    return list(lines(Painter(heard(estimate), Marks()).work(made, NOW), language))


def test_a_weight_with_its_truck():
    said = shown(weighed(WEIGHT), loading())
    assert said[:2] == ["1003 kg ± 6 kg", "OK"]
    assert said[3] == "Truck 3: 4000 / 5000 kg, Buckets: 4"
    booked, hanging = round(WIDTH * 0.8 / 1.25), round(WIDTH * 5003.4 / 5000.0 / 1.25)
    bar = said[4].replace("|", "")
    assert (bar.count("█"), bar.count("▒"), len(bar)) == (booked, hanging - booked, WIDTH)
    assert said[4].index("|") == 32  # 100 % of 125 %
    assert said[5].split() == ["4", "900", "kg"]


def test_masses_in_pounds_and_the_part_of_a_truck():
    made = loading()
    made.known = made.known._replace(in_part=453.59237, part=2, trailer=3000.0)
    said = list(lines(Painter(heard(weighed(WEIGHT)), Marks()).work(made, NOW), "en", MASS_UNITS["lb"]))
    assert said[0] == "2212 lb ± 12 lb"
    assert said[3] == "Truck 3, part 2: 1000 / 11023 lb, in all 8818 lb, Buckets: 4"


@pytest.mark.parametrize("language", languages())
def test_without_a_weight_there_is_a_reason_and_no_number(language):
    for reason in (Reason.OTHER_TOOL, Reason.SIGNAL_STALE):
        said = shown(no_estimate(NOW, reason, None), Loading(), language)
        assert said[0]
        assert "kg" not in " ".join(said)


def advice(total, filled, target=5000.0, net=None):
    estimate = no_estimate(NOW, Reason.STARTING, None) if net is None else weighed(replace(WEIGHT, value=net + 20.0))
    truck = Painter(heard(estimate), Marks()).work(loading(total, filled, target), NOW)["truck"]
    return truck["last_bucket"], truck["next_share"], truck["tip_off"], truck["overloads"]


def test_how_much_of_the_next_bucket():
    assert advice(4400.0, 4) == (True, pytest.approx(600.0 / 1100.0), None, False)
    assert advice(4700.0, 5) == (True, pytest.approx(300.0 / 940.0), None, True)  # 5640 kg are above 110 %
    assert advice(1000.0, 1) == (False, 1.0, None, False)
    assert advice(5000.0, 5) == (False, None, None, True)


def test_what_to_tip_off():
    assert advice(4400.0, 4, net=900.0)[2] == pytest.approx(300.0)
    assert advice(4400.0, 4, net=500.0)[2] is None


def test_it_reminds_of_the_zero():
    listener = Listener(SERVICE)
    painter = Painter(listener, Marks(check_zero_min=30.0))
    minute = 60_000_000
    assert [painter.work(Loading(), NOW + k * minute)["check_zero"] for k in (0, 29, 31)] == [False, False, True]
    refused = bytes.fromhex("80256101 22000008")
    for data, after in ((refused, True), (bytes.fromhex("60256101 00000000"), False)):
        listener.on_frame(Frame(NOW + 32 * minute, 0x580 + SERVICE.node_id, data))
        assert painter.work(Loading(), NOW + 33 * minute)["check_zero"] is after
    assert Painter(listener, Marks()).work(Loading(), NOW + 999 * minute)["check_zero"] is False
