"""The chapters beside the code: what they list is what the code does, and every link leads somewhere."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from cylforce.can.clock import now_us
from cylforce.canopen.devices import own_node
from cylforce.canopen.network import Network
from cylforce.canopen.node import SILENT
from cylforce.diagnosis.decide import Verdict
from cylforce.effects.fault import shapes
from cylforce.effects.library import LIBRARY
from cylforce.estimation.filters import Filter
from cylforce.estimation.model import Model
from cylforce.programs.live.station import OVERRUN
from cylforce.programs.run import MISSING
from cylforce.service import commands
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Quantity, Reason, Status
from cylforce.signals.events import Frame
from cylforce.signals.layout import CODES, TYPE_NAMES, not_available

ROOT = Path(__file__).resolve().parents[2]
CHAPTERS = [
    p for p in sorted(ROOT.rglob("*.md")) if not any(part.startswith(".") for part in p.relative_to(ROOT).parts)
]
SERVICE_PAGE = (ROOT / "src/cylforce/service/README.md").read_text()
EXCAVATOR = ROOT / "config/excavator_20t.toml"
SHORT = {"INTEGER32": "i32", "INTEGER16": "i16", "UNSIGNED16": "u16", "UNSIGNED8": "u8", "UNSIGNED32": "u32"}


def rows_of(page: str) -> list[list[str]]:
    """Cells of every table row of a page."""
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in page.splitlines() if line.startswith("| ")]


@pytest.mark.parametrize("page", CHAPTERS, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_relative_link_resolves(page: Path) -> None:
    for target in re.findall(r"\]\(([^)\s]+)\)", page.read_text()):
        if not re.match(r"[a-z]+:|#", target):
            assert (page.parent / target.partition("#")[0]).exists(), f"{page}: {target}"


@pytest.mark.parametrize("reason", Reason)
def test_every_reason_is_explained(reason: Reason) -> None:
    found = [row for row in rows_of(SERVICE_PAGE) if row[:2] == [str(int(reason)), reason.name]]
    assert len(found) == 1
    assert all(found[0][4:]), "what it means, what to do"


@pytest.mark.parametrize("code", [SILENT, MISSING, OVERRUN])
def test_every_emergency_is_explained(code: int) -> None:
    assert [row for row in rows_of(SERVICE_PAGE) if row[0] == f"{code:04X}h"]


def test_the_table_of_pdos_is_what_is_sent() -> None:
    rows = [row for row in rows_of(SERVICE_PAGE) if re.fullmatch(r"\d+, [0-7](-[0-7])?", row[0])]
    service = load(EXCAVATOR).service
    said = {row[0]: (row[2], row[3]) for row in rows}
    sent, missing = {}, {row[0]: row[6] for row in rows}
    for pdo in service.publication:
        at = 0
        for f in pdo.fields:
            size = CODES[f.code]
            place = f"{pdo.number}, {at}" + (f"-{at + size - 1}" if size > 1 else "")
            sent[place] = (f"{f.index:04X}h:{f.sub}", SHORT[TYPE_NAMES[f.code]])
            if missing[place]:
                assert int(missing[place][:-1], 16) == int(not_available(f.code)) % 256**size
            at += size
    assert said == sent


@pytest.mark.parametrize(("what", "frame"), [("zero", "640#232561017A65726F"), ("tare", "640#2339610174617265")])
def test_the_frames_of_zero_and_tare_are_obeyed(what: str, frame: str) -> None:
    assert frame in SERVICE_PAGE
    can_id, _, data = frame.partition("#")
    command = commands.read(Frame(0, int(can_id, 16), bytes.fromhex(data)), 64)
    assert command is not None
    good = Quantity(5.0, 1.0, Status.OK, Reason.NONE)
    assert (command.what, commands.obey(command, commands.Scale(), good, 1500.0)[1].verdict) == (what, 0)


@pytest.mark.parametrize(
    ("verdict", "request_hex", "code"),
    [
        (commands.NOT_NOW, "232561017A65726F", "0800 0022h"),
        (commands.OUT_OF_RANGE, "232561017A65726F", "0609 0030h"),
        (commands.WRONG_VALUE, "2325610100000000", "0609 0030h"),
        (None, "2B2561017A650000", "0607 0010h"),
        (None, "2125610105000000", "0800 0020h"),
        (None, "232561027A65726F", "0609 0011h"),
        (None, "4025610100000000", "0601 0001h"),
    ],
)
def test_refusals_of_zero_and_tare_have_the_codes_explained(verdict: int | None, request_hex: str, code: str) -> None:
    answers: list[bytes] = []

    def send(can_id: int, data: bytes) -> bool:
        answers.append(bytes(data))
        return True

    network = Network(send)
    node = own_node(load(EXCAVATOR).service, lambda: verdict, lambda node_id, state: None)
    network.add_node(node)
    network.poll(now_us())
    node.boot()
    answers.clear()
    network.on_frame(Frame(now_us(), 0x640, bytes.fromhex(request_hex)))
    assert answers[0][0] == 0x80
    assert f"{int.from_bytes(answers[0][4:], 'little'):08X}h" == code.replace(" ", "")
    assert [row for row in rows_of(SERVICE_PAGE) if row[0] == code]


def through(model: Model, hertz: float) -> tuple[float, float]:
    """Gain and delay [s] of a sine of a cylinder's force on its way through the filter of the force."""
    fast = Filter(*second_order_of(model))
    t = np.arange(0.0, 10.0, 1.0 / model.filters.rate_hz)
    _, passed = fast.run(fast.zero(()), np.sin(2.0 * np.pi * hertz * t))
    waves = np.stack([np.sin(2.0 * np.pi * hertz * t), np.cos(2.0 * np.pi * hertz * t)], axis=1)[t > 2.0]
    (a, b), *_ = np.linalg.lstsq(waves, passed[t > 2.0], rcond=None)
    return float(np.hypot(a, b)), float(-np.arctan2(b, a) / (2.0 * np.pi * hertz))


def second_order_of(model: Model) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Coefficients of a Butterworth low-pass, from scipy alone."""
    b, a = signal.butter(2, model.filters.force_hz, fs=model.filters.rate_hz)
    return tuple(b.tolist()), tuple(a.tolist())


def test_bandwidth_and_delay_are_those_of_the_shipped_filters() -> None:
    """The delay: 1.5 steps until a signal is used, the filter, half a publication period."""
    row = next(row for row in rows_of(SERVICE_PAGE) if row[0].startswith("resultant and soil force"))
    bandwidth, delay = float(row[1].split()[0]), float(row[2].split()[0])
    service = load(EXCAVATOR).service
    model = Model(service.machine, service.filters, ("coulomb",))
    f, period = service.filters, service.publication[1].period_s
    late = 0.195 / f.force_hz + 1.5 / f.rate_hz + (period - 1.0 / f.rate_hz) / 2.0
    assert through(model, 0.5)[1] == pytest.approx(0.195 / f.force_hz, abs=0.001)
    assert late == pytest.approx(model.fast.delay + 1.5 / f.rate_hz + (period - 1.0 / f.rate_hz) / 2.0, abs=0.001)
    assert delay == pytest.approx(1e3 * late, abs=1.0)
    note = next(field.note for field in service.publication[1].fields)
    assert note == f"-3 dB at {bandwidth:g} Hz, delay {delay:g} ms"
    held = np.sinc(bandwidth * period)  # a value stays on the bus until the next one comes
    assert through(model, bandwidth)[0] * held == pytest.approx(0.5**0.5, abs=0.02)


def test_every_section_of_the_physics_that_is_cited_exists() -> None:
    page = (ROOT / "src/cylforce/mechanics/README.md").read_text()
    written = {int(number) for number in re.findall(r"^## (\d+)\. ", page, re.MULTILINE)}
    cited: set[int] = set()
    for source in [*ROOT.glob("src/**/*.py"), *ROOT.glob("tests/**/*.py"), *ROOT.glob("tools/**/*.py")]:
        assert not re.search(r"PHYSICS[ ,]+(section|\d)", source.read_text()), f"{source}: cite mechanics/README.md"
        for numbers in re.findall(r"mechanics/README\.md,\s+sections? ([\d, and]+)", source.read_text()):
            cited |= {int(number) for number in re.findall(r"\d+", numbers)}
    assert cited
    assert cited <= written


def test_the_library_is_listed_with_its_plausible_sizes() -> None:
    rows = {row[0]: row[1:5] for row in rows_of((ROOT / "src/cylforce/effects/README.md").read_text())}
    for name in {group[0].about.name for group in LIBRARY}:
        forms = [group[0].about for group in LIBRARY if group[0].about.name == name]
        where = ", ".join(dict.fromkeys(about.place for about in forms))
        low, high = min(about.low for about in forms), max(about.high for about in forms)
        refined = dict.fromkeys(
            f"`{shape.field}`" for group in LIBRARY if group[0].about.name == name for shape in shapes(group)
        )
        assert rows[f"`{name}`"] == [where, forms[0].unit, f"{low:g} to {high:g}", ", ".join(refined)]
        assert {about.unit for about in forms} == {forms[0].unit}


@pytest.mark.parametrize("verdict", Verdict)
def test_every_verdict_is_explained(verdict: Verdict) -> None:
    page = (ROOT / "src/cylforce/diagnosis/README.md").read_text()
    assert [row for row in rows_of(page) if row[0] == f"`{verdict}`"]
