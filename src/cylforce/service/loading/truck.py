"""Truck (or any other target) that is being loaded: its buckets, and the operator's commands about it."""

from dataclasses import dataclass, replace

from cylforce.signals.estimate import Booking

KEPT = 32  # buckets of a truck that can still be cancelled, the last ones; chosen
LARGEST_TARGET = 1e6  # kg; chosen
DONE = 0
NOT_NOW = 0x08000022  # SDO abort code (CiA 301): refused because of the present device state
OUT_OF_RANGE = 0x06090030  # SDO abort code (CiA 301): value range exceeded


@dataclass(frozen=True, slots=True)
class Bucket:
    """Booked bucket.

    number:   of the booking
    mass:     that left the bucket, less the tare [kg]
    accepted: whether its mass counts
    part:     of the truck that received it
    """

    number: int
    mass: float
    accepted: bool = True
    part: int = 1


@dataclass(frozen=True, slots=True)
class Truck:
    """Open truck.

    number:  of the truck
    target:  of the present part [kg]; 0: none
    product: number of its product; 0: none
    total:   mass of the accepted buckets [kg]
    filled:  number of the accepted buckets
    buckets: the last KEPT buckets, accepted or not
    part:    1: the truck itself; 2 and more: its trailer, or its remaining space for another product
    in_part: mass of the accepted buckets in the present part [kg]
    first:   target of the first part [kg]; kept from the second part on, 0 before
    trailer: target of the trailer [kg]
    """

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


@dataclass(frozen=True, slots=True)
class Ruling:
    """Result of a command about the truck.

    truck:   after the command
    verdict: 0: done; else the SDO abort code
    words:   the decision, for a person
    """

    truck: Truck
    verdict: int
    words: str


def add_bucket(truck: Truck, booking: Booking, tare: float) -> Truck:
    """Return the truck with one more bucket, whose mass is the booking's dumped mass less the `tare` [kg]."""
    mass = booking.dumped - tare
    buckets = (*truck.buckets, Bucket(booking.number, mass, part=truck.part))[-KEPT:]
    return replace(_changed(truck, truck.part, mass), filled=truck.filled + 1, buckets=buckets)


def correct_bucket(truck: Truck, number: int, change: float) -> Truck:
    """Return the truck with the mass of the bucket of booking `number` corrected by `change` [kg].

    It is unchanged if that bucket is not among the last KEPT. The correction of a cancelled bucket does not count in
    the sums."""
    found = next((bucket for bucket in truck.buckets if bucket.number == number), None)
    if found is None:
        return truck
    buckets = tuple(replace(b, mass=b.mass + change) if b is found else b for b in truck.buckets)
    return replace(_changed(truck, found.part, found.accepted * change), buckets=buckets)


def _changed(truck: Truck, part: int, by: float) -> Truck:
    """Return the truck with the mass `by` [kg] added to its total, and to `in_part` if `part` is the present part."""
    return replace(truck, total=truck.total + by, in_part=truck.in_part + (by if part == truck.part else 0.0))


def set_target(truck: Truck, target: float) -> Ruling:
    """Return the truck with another target [kg] of its present part; 0: none. A target out of range is refused."""
    if (refusal := _out_of_range(truck, target)) is not None:
        return refusal
    return Ruling(replace(truck, target=target), DONE, f"target set to {target:.1f} kg")


def set_trailer_target(truck: Truck, target: float) -> Ruling:
    """Return the truck with another target [kg] of its trailer, or of any other next part; 0: none.

    A target out of range is refused."""
    if (refusal := _out_of_range(truck, target)) is not None:
        return refusal
    return Ruling(replace(truck, trailer=target), DONE, f"target of the trailer set to {target:.1f} kg")


def _out_of_range(truck: Truck, target: float) -> Ruling | None:
    """Return the refusal of a target [kg] outside 0 to LARGEST_TARGET; None: it is accepted."""
    if 0.0 <= target <= LARGEST_TARGET:
        return None
    return Ruling(truck, OUT_OF_RANGE, f"target refused: {target:.1f} kg is not 0 (none) to {LARGEST_TARGET:.0f} kg")


def next_part(truck: Truck) -> Ruling:
    """Return the truck with its next part begun: the trailer, or the space for another product.

    The part has its own sum, from 0 on, and the target that was set for the trailer [kg]."""
    first = truck.target if truck.part == 1 else truck.first
    after = replace(truck, part=truck.part + 1, in_part=0.0, first=first, target=truck.trailer)
    return Ruling(
        after, DONE, f"truck {truck.number}, part {truck.part} with {truck.in_part:.1f} kg, part {after.part} begun"
    )


def set_product(truck: Truck, product: int) -> Ruling:
    """Return the truck with another number of its product from the next bucket on, 0 (none) to 65535.

    Any other number is refused."""
    if not 0 <= product < 1 << 16:
        return Ruling(truck, OUT_OF_RANGE, f"product refused: {product} is not 0 (none) to 65535")
    return Ruling(replace(truck, product=product), DONE, f"product {product} from the next bucket on")


def next_truck(truck: Truck) -> Ruling:
    """Return an empty truck with the next number, and with the same targets and product."""
    target = truck.target if truck.part == 1 else truck.first
    after = Truck(truck.number + 1, target, truck.product, trailer=truck.trailer)
    return Ruling(after, DONE, f"truck {truck.number} closed with {truck.total:.1f} kg, truck {after.number} opened")


def set_accepted(truck: Truck, number: int, accepted: bool) -> Ruling:
    """Return the truck with one bucket cancelled, whose mass then does not count, or accepted again.

    A repeated command has no further effect. A bucket that is not among the last KEPT ones is refused.

    number:   of the bucket's booking
    accepted: whether it is accepted; else cancelled
    """
    what = "accepted" if accepted else "cancelled"
    found = next((bucket for bucket in truck.buckets if bucket.number == number), None)
    if found is None:
        where = f"the last {KEPT} buckets of truck {truck.number}"
        return Ruling(truck, NOT_NOW, f"booking {number} cannot be {what}: it is not among {where}")
    if found.accepted is accepted:
        return Ruling(truck, DONE, f"booking {number} is {what} already")
    sign = 1 if accepted else -1
    buckets = tuple(replace(b, accepted=accepted) if b is found else b for b in truck.buckets)
    after = replace(_changed(truck, found.part, sign * found.mass), filled=truck.filled + sign, buckets=buckets)
    return Ruling(after, DONE, f"booking {number} {what}: {found.mass:.1f} kg")
