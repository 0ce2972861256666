"""Bookings of a machine, step by step: each step gives a new state and leaves the one before as it was."""

from cylforce.service.booking import BookingConstants, Bookings

RATED = 1500.0  # kg
RATE_HZ = 100.0


def constants(tares):
    """The constants of the bookings of a machine with these tares."""
    return BookingConstants(tares, RATED, RATE_HZ)


def bookings(tares, **state):
    """The bookings of a machine with these tares, in a state."""
    found = Bookings.start(constants(tares))
    for name, value in state.items():
        setattr(found, name, value)
    return found


def changed(before, change):
    """A copy that `change` has changed."""
    found = Bookings.start(before.constants)
    found.restore(before.snapshot())
    change(found)
    return found


def noted(books, weight, t, drift):
    """A copy that got another weight."""
    return changed(books, lambda found: found.update(weight, t, drift))
