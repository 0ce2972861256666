"""How far an angle may turn from one sample to the next before it is the sensor's fault, by hand."""

from math import radians

import pytest

from cylforce.estimation.kernel import choice
from cylforce.service.assembler import assembler
from cylforce.settings.machine_file import load
from cylforce.signals.codec import encode
from cylforce.signals.estimate import Reason
from cylforce.signals.events import Frame
from scenarios import EXCAVATOR, pdo_of

SERVICE = load(EXCAVATOR).service
PDO = pdo_of(SERVICE, "stick_angle")
AT = [s.name for s in SERVICE.machine.signals].index("stick_angle")


def reason(turn, seconds):
    """What is wrong with an angle that is `turn` [rad] off its last after so long a time."""
    inputs = assembler(SERVICE)
    for k in range(21):
        later = seconds if k == 20 else 0.01
        angle = radians(-90.0) + (turn if k == 20 else 0.0)
        t_us = 1_000_000 + round(1e6 * (0.01 * (min(k, 19)) + later * (k == 20)))
        inputs.receive([Frame(t_us, PDO.can_id, encode(PDO, {"stick_angle": angle}))])
    return Reason(int(inputs.channels[AT].reason))


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("seconds", "room"), [(0.01, 0.030), (0.05, 0.150)])
def test_an_angle_may_turn_by_three_radians_a_second_and_its_own_noise(sign, seconds, room):
    """Noise: six standard errors of 0.01 degrees and two digits of that, 0.08 degrees or 1.4 mrad."""
    room += radians(0.08)
    assert reason(sign * (room - 0.002), seconds) is Reason.NONE
    assert reason(sign * (room + 0.002), seconds) is Reason.IMPLAUSIBLE_JUMP


@pytest.fixture(params=["interpreted", "chosen"])
def form(request):
    """Each form of the kernel."""
    with choice.using(choice.INTERPRETED if request.param == "interpreted" else choice.choice().kernel):
        yield


def judged(values):
    """What is wrong with each of an angle's values, (time [ms], turn [rad]), after a second at 100 Hz without turn."""
    inputs, reasons = assembler(SERVICE), []
    for ms, turn in [*((-10.0 * k, 0.0) for k in range(100, -1, -1)), *values]:
        frame = Frame(5_000_000 + round(1000 * ms), PDO.can_id, encode(PDO, {"stick_angle": radians(-90.0) + turn}))
        inputs.receive([frame])
        reasons.append(Reason(int(inputs.channels[AT].reason)))
    return reasons[-len(values) :]


@pytest.mark.usefixtures("form")
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("full", "room"), [(100.0, 0.27075), (250.0, 0.72075)])
def test_an_angle_that_waited_for_the_bus_may_have_turned_meanwhile(full, room, sign):
    """The bus is full for so many ms. A value that leaves then may have been measured 10 ms after the last one; that
    which follows by 0.25 ms may be 90.25 ms younger, or 240.25 ms: 3 rad/s of that, and noise and digits."""
    for more, why in ((-0.002, Reason.NONE), (0.002, Reason.IMPLAUSIBLE_JUMP)):
        turn = sign * (room + radians(0.08) + more)
        assert judged([(full, 0.0), (full + 0.25, turn)]) == [Reason.NONE, why]


@pytest.mark.usefixtures("form")
def test_angles_that_waited_one_behind_the_other_were_measured_a_period_apart():
    """Of three that waited 100 ms the second was measured after 10 ms, the third may be 80.5 ms younger. Two values at
    their time later, all that may be is again the turn of a period."""
    for turn, why in ((0.241, Reason.NONE), (0.245, Reason.IMPLAUSIBLE_JUMP)):
        assert judged([(100.0, 0.0), (100.25, 0.0), (100.5, turn)]) == [Reason.NONE, Reason.NONE, why]
    for turn, why in ((0.029, Reason.NONE), (0.033, Reason.IMPLAUSIBLE_JUMP)):
        assert judged([(100.0, 0.0), (100.25, 0.0), (110.0, 0.0), (120.0, turn)])[-1] is why


def course(angles):
    """The assembler after an angle's values [rad] at 100 Hz."""
    inputs, reasons = assembler(SERVICE), []
    for k, angle in enumerate(angles):
        frame = Frame(1_000_000 + 10_000 * k, PDO.can_id, encode(PDO, {"stick_angle": angle}))
        inputs.receive([frame])
        reasons.append(Reason(int(inputs.channels[AT].reason)))
    return reasons, inputs.stepped


@pytest.mark.parametrize("leap", [0.05, -0.05])
@pytest.mark.parametrize("speed", [0.0, 0.1, -0.1])
def test_an_angle_that_leapt_is_off_although_the_joint_passes_where_it_was(leap, speed):
    """Within the second in which it is not believed the joint moves by a tenth, past the angle before the leap."""
    moving = [radians(-90.0) + speed * 0.01 * k for k in range(300)]
    off = [angle + leap * (k >= 50) for k, angle in enumerate(moving)]
    reasons, stepped = course(off)
    assert reasons[50:150] == [Reason.IMPLAUSIBLE_JUMP] * 100
    assert reasons[-1] is Reason.NONE
    assert stepped == (AT,)
    back = [angle + leap * (50 <= k < 120) for k, angle in enumerate(moving)]
    reasons, stepped = course(back)
    assert (reasons[119], reasons[-1], stepped) == (Reason.IMPLAUSIBLE_JUMP, Reason.NONE, ())
    twice = [angle + leap * (50 <= k < 200) for k, angle in enumerate([*moving, *moving[-1:] * 100])]
    assert course(twice)[1] == ()


def test_the_inputs_show_every_signal_every_pdo_and_every_node():
    """A value each, and its time; a second too late all are missing but for it."""
    inputs = assembler(SERVICE)
    pdos = [pdo for node in SERVICE.nodes for pdo in node.pdos]
    assert (len(inputs.channels), len(inputs.pdos), len(inputs.nodes)) == (
        len(SERVICE.machine.signals),
        len(pdos),
        len(SERVICE.nodes),
    )
    said = {s.name: 0.25 * (s.low + s.high) + 0.1 for s in SERVICE.machine.signals}
    for n in range(1 - SERVICE.health.good_frames, 1):
        sent = [Frame(1_000_000 + 10_000 * n + k, pdo.can_id, encode(pdo, said)) for k, pdo in enumerate(pdos)]
        inputs.receive(sent)
    for signal, channel in zip(SERVICE.machine.signals, inputs.channels, strict=True):
        assert channel.reason == Reason.NONE
        assert channel.value == pytest.approx(said[signal.name], rel=1e-3, abs=3e-3)
        assert channel.t_us == 1_000_000 + pdos.index(pdo_of(SERVICE, signal.name))
    assert [pdo.t_us for pdo in inputs.pdos] == [1_000_000.0 + k for k in range(len(pdos))]
    unknown = inputs.counters.unknown
    inputs.receive([Frame(2_000_000, 0x7FF, b"")])
    assert inputs.counters.unknown == unknown + 1
    ages = inputs.ages(2_000_000)
    assert max(ages) == pytest.approx(1.0, abs=1e-4)
    sample = inputs.sample(2_000_000)
    assert set(sample.reasons) == {Reason.SIGNAL_STALE}
