"""`cylforce display`: checks its options and serves the page."""

from functools import partial
from pathlib import Path

from cylforce.can.opening import open_shared_bus
from cylforce.programs.common.addresses import host_and_port, secret_of
from cylforce.programs.common.machine_file import load_machine
from cylforce.signals.units import mass_unit

LEAST_PIN = 4


def display(
    machine: Path,
    bus: str,
    records: Path | None,
    address: str,
    names: tuple[str, ...],
    pin_file: Path | None,
    marks: tuple[float, float, float, float],
    language: str,
    unit: str = "kg",
) -> None:
    """Serve the page until a signal. Raises SettingsError, BusError or ValueError with a sentence."""
    try:
        from cylforce.display.picture import Marks
        from cylforce.display.serving import Served, run_display
    except ImportError as error:
        raise ValueError(f"the display needs more packages ({error.name}): pip install 'cylforce[display]'") from error
    host, port = host_and_port("--listen", address)
    shares = Marks(*shares_of(marks))
    mass_unit(unit)
    pin = read_pin(pin_file, host)
    service = load_machine(machine).service
    served = Served(service, records, host, port, names, pin, shares, language, unit)
    run_display(served, open_shared_bus(bus), partial(print, flush=True))


def display_in_terminal(
    machine: Path, bus: str, marks: tuple[float, float, float, float], language: str, unit: str = "kg"
) -> None:
    """Show the display as text until a signal. Raises SettingsError, BusError or ValueError with a sentence."""
    from cylforce.display.picture import Marks
    from cylforce.display.terminal import run_terminal

    shares, shown, service = Marks(*shares_of(marks)), mass_unit(unit), load_machine(machine).service
    run_terminal(service, open_shared_bus(bus), shares, language, shown)


def shares_of(marks: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    """Return the marks of the target bar as shares, and the minutes of the reminder.

    Raises ValueError unless the marks, given in percent, rise.
    """
    amber, green, red = (0.01 * mark for mark in marks[:3])
    if not 0.0 < amber <= green <= red:
        raise ValueError("--amber, --green, --red: must rise, in percent of the target, e.g. 75, 95, 110")
    return amber, green, red, marks[3]


def read_pin(pin_file: Path | None, host: str) -> str:
    """Return the PIN; none is needed where only this computer reaches the page. Raises ValueError."""
    from cylforce.display.serving import is_loopback

    if pin_file is None:
        if not is_loopback(host):
            raise ValueError(f"--listen {host}: other computers reach it, so changes need a PIN: give --pin-file FILE")
        return ""
    pin = secret_of("--pin-file", pin_file)
    if len(pin) < LEAST_PIN:
        raise ValueError(f"--pin-file {pin_file}: the PIN is too short: write at least {LEAST_PIN} characters")
    return pin
