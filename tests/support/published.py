"""What the display receives of the service: listeners, weights and estimates."""

from dataclasses import replace

from cylforce.display.listener import Listener
from cylforce.service.publication import frames
from cylforce.settings.machine_file import load
from cylforce.signals.codec import encode
from cylforce.signals.estimate import Quantity, Reason, Status, no_estimate
from cylforce.signals.events import Frame
from scenarios import EXCAVATOR

SERVICE = load(EXCAVATOR).service
NOW = 1_700_000_000_000_000
WEIGHT = Quantity(1023.4, 5.6, Status.OK, Reason.NONE)


def heard(estimate, t_us=NOW):
    """A listener that has heard the service publish an estimate, and a posture."""
    listener = Listener(SERVICE)
    ids = {pdo.number: pdo.can_id for pdo in SERVICE.publication}
    for number, data in frames(SERVICE.publication, estimate):
        listener.on_frame(Frame(t_us, ids[number], data))
    angles = {"boom_angle": 0.3, "stick_angle": -1.5, "bucket_angle": -1.0}
    for pdo in (pdo for node in SERVICE.nodes for pdo in node.pdos):
        for k in range(12):
            listener.on_frame(Frame(t_us - 12 + k, pdo.can_id, encode(pdo, angles)))
    return listener


def weighed(q):
    return replace(no_estimate(NOW, Reason.STARTING, None), gross=q, net=replace(q, value=q.value - 20.0))
