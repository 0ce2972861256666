"""What the study of cycles runs instead of a replay books the same."""

from math import sqrt

import numpy as np
import pytest

from cylforce.commissioning.identification import identify
from cylforce.programs.common.readings import model_of, recorded_segments
from cylforce.programs.replay import replay_through
from cylforce.service.core import Core
from cylforce.settings.machine_file import load
from reference_machine.machine import draw
from reference_machine.shift import Job
from studies._quick import served


def test_the_quick_way_books_what_a_replay_books(tmp_path):
    """A bucket of which a part is tipped off, one in two parts: the same weights, and the truth. Which moment of a lift
    is the surest depends on errors that nobody notices, of which the quick way knows nothing: by what these add to the
    standard error the weights may differ, and else by a kilogram."""
    made = draw(301, friction="foreign")
    empty = made.run("commissioning", seed=0, duration_s=90.0).write(tmp_path)
    recording = made.run("shift", seed=1, jobs=(Job("tip_off", 900.0), Job("two_parts", 700.0)))
    path, loaded = recording.write(tmp_path), load(tmp_path / "machine.toml")
    core = Core(loaded.service, identify(model_of(loaded), recorded_segments(loaded, empty), refuse=False).tares)
    replayed = replay_through(core, loaded, path, lambda _: None).bookings
    names = [signal.name for signal in loaded.service.machine.signals]
    values = np.stack([recording.column(name) for name in names], axis=-1)
    quick = {}
    for service in served(core, values):
        booking = service.bookings.booking
        quick |= {} if booking is None else {booking.number: booking}
    assert [booking.number for booking in replayed] == [1, 2]
    for a, b, truth in zip(replayed, quick.values(), (0.65 * 900.0, 700.0), strict=True):
        more = sqrt(abs(a.standard_error**2 - b.standard_error**2))
        assert more < 0.005 * loaded.service.machine.rated_payload
        assert a.dumped == pytest.approx(b.dumped, abs=max(more, 1.0))
        assert a.dumped == pytest.approx(truth, abs=15.0)
