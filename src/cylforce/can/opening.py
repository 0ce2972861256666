"""Open a bus by its name."""

from collections.abc import Callable

from cylforce.can.bus import Bus, BusError
from cylforce.can.clock import now_us
from cylforce.can.socketcan import SocketCan


def open_shared_bus(name: str) -> Bus:
    """Open a bus as `open_bus`, for a program that communicates with other programs.

    Raises BusError with a sentence, also for a virtual bus, which exists inside one process only.
    """
    if name.startswith("virtual:") and name != "virtual:":
        raise BusError(
            f"{name}: exists inside one process only, so no other program is on it: use socketcan:NAME or "
            "remote:127.0.0.1:PORT; only `cylforce demo` can use it"
        )
    return open_bus(name)


def open_bus(name: str, now: Callable[[], int] = now_us) -> Bus:
    """Open a bus by "INTERFACE:CHANNEL".

    Raises BusError with a sentence where the interface is unknown or refused, the channel is missing, or the bus cannot
    be opened. Names are `socketcan:can0`, `virtual:NAME` (inside one process), `remote:127.0.0.1:PORT`.

    now: clock that stamps the frames [us]
    """
    interface, _, channel = name.partition(":")
    if not channel:
        raise BusError(f"the bus {name!r} has no channel: write INTERFACE:CHANNEL, e.g. socketcan:can0")
    if interface == "socketcan":
        return SocketCan(channel, now)
    if interface in ("virtual", "remote"):
        from cylforce.can import python_can

        return python_can.Virtual(channel, now) if interface == "virtual" else python_can.Remote(channel, now)
    if interface == "udp_multicast":
        raise BusError("udp_multicast would send frames out of this machine: use socketcan, virtual or remote")
    raise BusError(f"there is no interface {interface!r}: use socketcan:NAME, virtual:NAME or remote:127.0.0.1:PORT")
