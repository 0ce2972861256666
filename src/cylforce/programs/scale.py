"""`cylforce scale`: the operator's commands from a terminal, over SDO to the running service."""

import asyncio
from pathlib import Path

from cylforce.can.bus import Bus
from cylforce.can.opening import open_shared_bus
from cylforce.canopen.network import Network
from cylforce.display.panel import NO_ANSWER, Panel, Reply, TruckState
from cylforce.display.words import REFUSALS
from cylforce.programs.common.machine_file import load_machine
from cylforce.signals.units import KILOGRAM, MassUnit

SHOW = "show"
ALONE, NUMBERED = ("zero", "tare", "next", "part"), ("target", "trailer", "product", "cancel", "accept", "add")
MASSES = ("target", "trailer", "add")  # orders with a mass
ATTACHMENT = "attachment"
ORDERS = (SHOW, *ALONE, *NUMBERED, ATTACHMENT)


def run_scale(machine: Path, bus_name: str, order: str, value: str | None, unit: MassUnit = KILOGRAM) -> bool:
    """Send an order, print the answer and the truck; return whether it was done.

    Raises ValueError for an invalid order.
    """
    service = load_machine(machine).service
    number = number_of(order, value, service.tools)
    number = number * unit.kg if number and order in MASSES else number
    bus = open_shared_bus(bus_name)
    try:
        reply, known = asyncio.run(ordered(bus, service.node_id, order, number or 0.0))
    finally:
        bus.close()
    print(REFUSALS[reply.why] if reply.why in REFUSALS else reply.why or told(known, service.tools, unit))
    return reply.done


def number_of(order: str, value: str | None, tools: tuple[str, ...]) -> float | None:
    """Return the number that an order needs; of an attachment its number among the tools.

    Raises ValueError for an unknown order, and where a number is missing, invalid, or not allowed.
    """
    if order not in ORDERS:
        raise ValueError(f"{order}: is no order: use {', '.join(ORDERS)}")
    if (order in (*NUMBERED, ATTACHMENT)) is not (value is not None):
        needs = "the name of an attachment" if order == ATTACHMENT else "a number"
        raise ValueError(f"{order}: " + (f"needs {needs} after it" if value is None else "takes no number"))
    if value is None:
        return None
    if order == ATTACHMENT:
        if value not in tools:
            raise ValueError(f"{value}: is no attachment of the machine file: use {', '.join(tools)}")
        return tools.index(value)
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"{order} {value}: is no number") from None


async def ordered(bus: Bus, node_id: int, order: str, number: float) -> tuple[Reply, TruckState | None]:
    """Return the service's answer to an order, and the truck afterwards."""
    network = Network(bus.send)
    bus.attach(asyncio.get_running_loop(), network.on_frame)
    panel = Panel(network, node_id)
    reply = Reply(True) if order == SHOW else await panel.send_command(order, number)
    await asyncio.sleep(0.1)  # the service shows the effect at its next step
    known = await panel.read() if reply.done else None
    return (reply, known) if known or not reply.done else (Reply(False, NO_ANSWER), None)


def told(known: TruckState | None, tools: tuple[str, ...], unit: MassUnit = KILOGRAM) -> str:
    """Return the truck in a line."""
    if known is None:
        return ""
    target = f" of {unit.text(known.target)} {unit.symbol}" if known.target else ""
    product = f", product {known.product}" if known.product else ""
    load = f"{unit.text(known.loaded)} {unit.symbol}{target} in {known.filled} buckets{product}"
    tool = f"; {tools[known.tool]}" if 0 < known.tool < len(tools) else ""
    part = f", part {known.part}" if known.part > 1 else ""
    load += f", {unit.text(known.total)} {unit.symbol} in all" if part else ""
    return f"truck {known.number}{part}: {load}; last booking {known.last}{tool}"
