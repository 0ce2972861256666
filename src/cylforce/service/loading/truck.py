"""The truck (or any other target) that is being loaded: which buckets it has received, and the operator's commands
about it."""

from typing import NamedTuple

from cylforce.signals.estimate import Booking

KEPT = 32  # buckets of a truck that can still be cancelled, the last ones; chosen
LARGEST_TARGET = 1e6  # kg; chosen
DONE = 0
NOT_NOW = 0x08000022  # SDO abort code (CiA 301): refused because of the present device state
TOO_FAR = 0x06090030  # SDO abort code (CiA 301): value range exceeded


class Bucket(NamedTuple):
    """A booked bucket: the booking's number, the mass that counts [kg], what left the bucket less the tare, whether it
    does, and into which part of the truck it went."""

    number: int
    mass: float
    accepted: bool = True
    part: int = 1


class Truck(NamedTuple):
    """The open truck: its number, target [kg] of the present part (0: none), number of its product (0: none), mass [kg]
    and number of the buckets that count, the last KEPT buckets. `part`: 1 the truck itself, from 2 on its trailer, or
    the rest of it for another product; mass `in_part` [kg]; targets [kg] of the `first` part and of the trailer."""

    number: int = 1
    target: float = 0.0
    product: int = 0
    total: float = 0.0
    filled: int = 0
    buckets: tuple[Bucket, ...] = ()
    part: int = 1
    in_part: float = 0.0
    first: float = 0.0
    trailer: float = 0.0


NO_TRUCK = Truck()


class Ruling(NamedTuple):
    """The truck after a command; 0, or the SDO abort code with which it is refused; what was decided, in words."""

    truck: Truck
    verdict: int
    words: str


def loaded(truck: Truck, booking: Booking, tare: float) -> Truck:
    """The truck after one more bucket: what left it, less the `tare` [kg]."""
    mass = booking.dumped - tare
    buckets = (*truck.buckets, Bucket(booking.number, mass, part=truck.part))[-KEPT:]
    return _changed(truck, truck.part, mass)._replace(filled=truck.filled + 1, buckets=buckets)


def refined(truck: Truck, number: int, change: float) -> Truck:
    """The truck when bucket `number` is known to have brought `change` [kg] more."""
    found = next((bucket for bucket in truck.buckets if bucket.number == number), None)
    if found is None:
        return truck
    buckets = tuple(b._replace(mass=b.mass + change) if b is found else b for b in truck.buckets)
    return _changed(truck, found.part, found.accepted * change)._replace(buckets=buckets)


def _changed(truck: Truck, part: int, by: float) -> Truck:
    """The truck with a mass [kg] more in one of its parts."""
    return truck._replace(total=truck.total + by, in_part=truck.in_part + (by if part == truck.part else 0.0))


def aimed(truck: Truck, target: float) -> Ruling:
    """Another target [kg] of the present part; 0: none."""
    if (refusal := _too_far(truck, target)) is not None:
        return refusal
    return Ruling(truck._replace(target=target), DONE, f"target set to {target:.1f} kg")


def trailer_aimed(truck: Truck, target: float) -> Ruling:
    """Another target [kg] of the trailer, or whatever part is next; 0: none."""
    if (refusal := _too_far(truck, target)) is not None:
        return refusal
    return Ruling(truck._replace(trailer=target), DONE, f"target of the trailer set to {target:.1f} kg")


def _too_far(truck: Truck, target: float) -> Ruling | None:
    if 0.0 <= target <= LARGEST_TARGET:
        return None
    return Ruling(truck, TOO_FAR, f"target refused: {target:.1f} kg is not 0 (none) to {LARGEST_TARGET:.0f} kg")


def next_part(truck: Truck) -> Ruling:
    """On to the trailer, or to the rest of the truck for another product: a part with a target and a sum of its own."""
    first = truck.target if truck.part == 1 else truck.first
    after = truck._replace(part=truck.part + 1, in_part=0.0, first=first, target=truck.trailer)
    return Ruling(
        after, DONE, f"truck {truck.number}, part {truck.part} with {truck.in_part:.1f} kg, part {after.part} begun"
    )


def of_product(truck: Truck, product: int) -> Ruling:
    """Another product, from the next bucket on."""
    if not 0 <= product < 1 << 16:
        return Ruling(truck, TOO_FAR, f"product refused: {product} is not 0 (none) to 65535")
    return Ruling(truck._replace(product=product), DONE, f"product {product} from the next bucket on")


def next_truck(truck: Truck) -> Ruling:
    """An empty truck with the same targets and product."""
    target = truck.target if truck.part == 1 else truck.first
    after = Truck(truck.number + 1, target, truck.product, trailer=truck.trailer)
    return Ruling(after, DONE, f"truck {truck.number} closed with {truck.total:.1f} kg, truck {after.number} opened")


def judged(truck: Truck, number: int, accepted: bool) -> Ruling:
    """Bucket `number` of this truck is cancelled, or accepted again; once more has no further effect."""
    what = "accepted" if accepted else "cancelled"
    found = next((bucket for bucket in truck.buckets if bucket.number == number), None)
    if found is None:
        where = f"the last {KEPT} buckets of truck {truck.number}"
        return Ruling(truck, NOT_NOW, f"booking {number} cannot be {what}: it is not among {where}")
    if found.accepted is accepted:
        return Ruling(truck, DONE, f"booking {number} is {what} already")
    sign = 1 if accepted else -1
    buckets = tuple(b._replace(accepted=accepted) if b is found else b for b in truck.buckets)
    after = _changed(truck, found.part, sign * found.mass)._replace(filled=truck.filled + sign, buckets=buckets)
    return Ruling(after, DONE, f"booking {number} {what}: {found.mass:.1f} kg")
