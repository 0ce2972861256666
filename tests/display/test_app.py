"""The page's server without a browser: who is refused, what is shown for which frames, how slow clients are treated."""

import asyncio
import json
import re
import struct
import subprocess
from io import BytesIO
from pathlib import Path

import httpx
import numpy as np
import pytest
from babel.messages.mofile import read_mo, write_mo
from babel.messages.pofile import read_po

from cylforce.can.opening import open_bus
from cylforce.display.app import STATIC, PageSources, application
from cylforce.display.guard import LOCKED_US, TRIES, Guard
from cylforce.display.listener import LATE_US, Listener
from cylforce.display.panel import Loading, TruckState, command_request
from cylforce.display.picture import SILENT, Marks, Painter
from cylforce.display.serving import Display, Served
from cylforce.display.stream import PATIENCE_S, Feed
from cylforce.display.words import FOLDER, PAGE, REASONS, catalogue, languages, messages, page_words
from cylforce.programs import scale
from cylforce.programs.common.addresses import host_and_port
from cylforce.programs.common.readings import make_core
from cylforce.programs.display import read_pin
from cylforce.programs.run import Daemon
from cylforce.records.labels import LABELS
from cylforce.service.memory import NOTHING_KEPT
from cylforce.settings.machine_file import load
from cylforce.signals.estimate import Reason, no_estimate
from cylforce.signals.events import Frame
from published import NOW, SERVICE, WEIGHT, heard, weighed
from scenarios import EXCAVATOR
from shifts import shift
from waiting import run_virtually, until


def painted(estimate, loading=None, later_us=0):
    loading = Loading() if loading is None else loading
    return Painter(heard(estimate), Marks()).work(loading, NOW + later_us)


def test_a_valid_weight_is_shown_with_its_error():
    weight = painted(weighed(WEIGHT))["weight"]
    assert weight == {"gross": 1023.4, "net": 1003.4, "error": 5.6, "status": 0, "reason": 0} | {
        key: pytest.approx(weight[key]) for key in ("gross", "net", "error")
    }
    assert weight["net"] == pytest.approx(1003.4)


@pytest.mark.parametrize("reason", [r for r in Reason if r not in (Reason.NONE, Reason.NO_CONTACT)])
def test_an_invalid_weight_is_its_reason_and_no_number(reason):
    weight = painted(no_estimate(NOW, reason, None))["weight"]
    assert weight == {"gross": None, "net": None, "error": None, "status": 3, "reason": int(reason)}


def test_what_is_old_is_not_shown():
    weight = painted(weighed(WEIGHT), later_us=LATE_US)["weight"]
    assert (weight["net"], weight["status"], weight["reason"]) == (None, 3, SILENT)


def test_the_arm_is_drawn_in_its_posture():
    picture = painted(weighed(WEIGHT))
    arm, machine = picture["arm"], SERVICE.machine
    place = complex(machine.tool_point(np.array([0.3, -1.5, -1.0])).place)
    assert arm["tool"] == pytest.approx((place.real, place.imag), abs=0.02)
    assert (len(arm["links"]), len(arm["cylinders"])) == (len(machine.links), len(machine.cylinders))
    json.dumps(picture, allow_nan=False)


def test_without_angles_there_is_no_arm():
    picture = Painter(Listener(SERVICE), Marks()).work(Loading(), NOW)
    assert picture["arm"] is None
    assert picture["weight"]["reason"] == SILENT


def test_target_remaining_and_last_bucket():
    loading = Loading()
    loading.update(TruckState(1, 4000.0, 4, 4, 4, 0, 5000.0, 1))
    truck = painted(weighed(WEIGHT), loading)["truck"]
    assert (truck["share"], truck["remaining"], truck["last_bucket"]) == (0.8, 1000.0, True)
    assert truck["with_bucket"] == pytest.approx(5003.4 / 5000.0)
    loading.update(TruckState(1, 5000.5, 5, 5, 5, 0, 5000.0, 1))
    assert [tuple(bucket) for bucket in loading.buckets] == [(5, 1000.5)]
    assert painted(weighed(WEIGHT), loading)["truck"]["last_bucket"] is False


def test_the_engineering_picture_names_nodes_and_reasons():
    listener = heard(weighed(WEIGHT))
    listener.on_frame(Frame(NOW, 0x740, b"\x05"))
    listener.on_frame(Frame(NOW, 0x0C0, struct.pack("<HB5x", 0x8250, 1)))
    picture = Painter(listener, Marks()).engineering(Loading(), NOW)
    [own] = [node for node in picture["nodes"] if node["name"] == "cylforce"]
    assert (own["state"], own["emergency"]) == (5, 0x8250)
    assert {s["name"] for s in picture["signals"]} == {s.name for s in SERVICE.machine.signals}
    assert 0 < picture["bits_per_second"] < 100_000
    json.dumps(picture, allow_nan=False)


def test_commands_become_sdo_writes():
    assert command_request("zero", 0) == (0x6125, 1, b"zero")
    assert command_request("target", 12_000.0) == (0x2190, 1, struct.pack("<i", 120_000))
    assert command_request("cancel", 7) == (0x2190, 4, struct.pack("<I", 7))
    assert command_request("format the disk", 0) is None
    assert command_request("product", -1) is None
    assert command_request("zero", None) == (0x6125, 1, b"zero")


def test_a_command_whose_number_is_missing_or_not_whole_is_none():
    """It would delete a target, or choose another product."""
    assert command_request("target", None) is None
    assert command_request("product", 1.5) is None


TYPED = (
    ("de", "1.500", 1500.0), ("de", "1.500,25", 1500.25), ("de", "1500,25", 1500.25), ("de", "12 000", 12_000.0),
    ("en", "1,500", 1500.0), ("en", "1,500.25", 1500.25), ("en", "1500.25", 1500.25), ("en", " 4000 ", 4000.0),
    ("fr", "1\u202f500,5", 1500.5), ("de", "0", 0.0), ("en", "-3", -3.0), ("de", "1.234.567", 1_234_567.0),
    ("de", "1.5", None), ("en", "1,5", None), ("de", "1,500.5", None), ("en", "1.500,5", None),
    ("en", "12,34,567", None), ("en", "", None), ("en", "4 t", None), ("en", "1e3", None), ("de", "--3", None),
    ("en", "1,500 000", None),
)  # fmt: skip
NODE = """
import { formatNumber, parseNumber } from "%s";
const typed = JSON.parse(process.argv[1]);
const values = [0, 15, 1500.5, 1234567.25, 0.125];
console.log(JSON.stringify({
  parsed: typed.map(([language, text]) => parseNumber(text, language)),
  returned: ["de", "en", "fr", "pl"].map((language) =>
    values.map((value) => parseNumber(formatNumber(value, language), language) === value)),
}));
"""


def test_a_number_is_read_as_the_language_writes_it():
    """Else 1.500 of a German keyboard is a target of 1.5 kg. What may be shown in the dialog is read back unchanged."""
    program = NODE % (STATIC / "numbers.js").as_uri()
    typed = json.dumps([[language, text] for language, text, _ in TYPED])
    command = ["node", "--no-warnings", "--experimental-default-type=module", "--eval", program, "--", typed]
    made = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    assert made["parsed"] == [value for _, _, value in TYPED]
    assert all(all(values) for values in made["returned"])


def test_commands_reach_a_service_and_its_answer_comes_back():
    """On a bus in this process: target done, zero refused with the service's own abort code."""

    async def main():
        machine = load(EXCAVATOR)
        daemon = Daemon(machine, make_core(machine, None), open_bus("virtual:panel"), None, NOTHING_KEPT)
        loop, bus = asyncio.get_running_loop(), open_bus("virtual:panel")
        display = Display(Served(SERVICE, None, "127.0.0.1", 0, (), "", Marks(), "en"), bus)
        bus.attach(loop, display.on_frame)
        daemon.start(loop)
        try:
            follow = asyncio.create_task(display.panel.follow())
            outcomes = [
                await display.panel.send_command(*words) for words in (("target", 9000.0), ("zero", 0), ("dance", 0))
            ]
            await until(lambda: (known := display.panel.loading.known) is not None and known.target > 0.0)
            follow.cancel()
            return outcomes, display.panel.loading.known
        finally:
            await daemon.stop(loop)
            bus.close()

    outcomes, known = asyncio.run(main())
    assert [tuple(o) for o in outcomes] == [(True, ""), (False, "08000022"), (False, "unknown")]
    assert (known.target, known.number, known.records) == (9000.0, 1, 0)


def test_orders_from_a_terminal():
    """The same commands as the page's; what was refused is said in words."""

    async def main():
        machine = load(EXCAVATOR)
        daemon = Daemon(machine, make_core(machine, None), open_bus("virtual:terminal"), None, NOTHING_KEPT)
        loop = asyncio.get_running_loop()
        daemon.start(loop)
        found = []
        try:
            for order, number in (("target", 9000.0), ("next", 0.0), ("cancel", 7.0), ("show", 0.0)):
                bus = open_bus("virtual:terminal")
                found.append(await scale.ordered(bus, SERVICE.node_id, order, number))
                bus.close()
        finally:
            await daemon.stop(loop)
        bus = open_bus("virtual:empty")
        found.append(await scale.ordered(bus, SERVICE.node_id, "show", 0.0))
        bus.close()
        return found

    target, following, cancel, shown, silent = asyncio.run(main())
    assert scale.told(target[1], SERVICE.tools) == "truck 1: 0.0 kg of 9000.0 kg in 0 buckets; last booking 0"
    assert following[1].number == shown[1].number == 2
    assert (cancel[0].done, cancel[0].why) == (False, "08000022")
    assert (silent[0].done, silent[0].why) == (False, "no answer")


@pytest.mark.parametrize(
    ("order", "number", "words"),
    [
        ("dance", None, "is no order: use show, zero"),
        ("target", None, "needs a number"),
        ("zero", "1.0", "takes no number"),
        ("target", "much", "target much: is no number"),
        ("attachment", None, "needs the name of an attachment"),
        ("attachment", "crab", "crab: is no attachment of the machine file: use standard, grab"),
    ],
)
def test_what_is_no_order_is_said(order, number, words):
    with pytest.raises(ValueError, match=words):
        scale.number_of(order, number, ("standard", "grab"))


class Web:
    """Asks the guarded application."""

    def __init__(self, records=None, pin="", hosts=("127.0.0.1",)):
        self.now_us = NOW
        channels = Feed(dict), Feed(dict)
        desk = PageSources(None, records, *channels, lambda: self.now_us)
        self.app = Guard(application(desk), hosts, pin, lambda: self.now_us)

    def ask(self, method, path, host="127.0.0.1:8080", **more):
        async def main():
            transport = httpx.ASGITransport(self.app)
            async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8080") as client:
                return await client.request(method, path, headers={"host": host, **more.pop("headers", {})}, **more)

        return asyncio.run(main())


@pytest.mark.parametrize("path", ["/", "/stream/work", "/stream/engineering", "/history", "/words"])
def test_foreign_hosts_and_origins_are_refused(path):
    """The event streams, too."""
    web = Web()
    assert web.ask("GET", path, host="evil.example").status_code == 421
    assert web.ask("GET", path, headers={"origin": "http://evil.example"}).status_code == 403
    assert web.ask("GET", path, headers={"sec-fetch-site": "cross-site"}).status_code == 403


def test_a_change_is_json():
    assert Web().ask("POST", "/command", data={"what": "zero"}).status_code == 415


def test_a_change_needs_the_pin_and_guessing_is_slow():
    web = Web(pin="2468")
    assert web.ask("GET", "/").status_code == 200
    assert web.ask("POST", "/zero-total", json={}).status_code == 401
    for _ in range(TRIES):
        assert web.ask("POST", "/zero-total", json={}, headers={"x-pin": "1111"}).status_code == 401
    assert web.ask("POST", "/zero-total", json={}, headers={"x-pin": "2468"}).status_code == 429
    web.now_us += LOCKED_US + 1
    assert web.ask("POST", "/zero-total", json={}, headers={"x-pin": "2468"}).status_code == 404  # no records


def test_history_ticket_and_totals(tmp_path):
    path = tmp_path / "records.db"
    shift(path, 3)
    web = Web(path)
    said = web.ask("GET", "/history").json()
    assert [row["booking"] for row in said["bookings"]] == [3, 2, 1]
    assert said["totals"]["grand"] == [{"product": 0, "loads": 3, "mass_kg": 303.0}]
    assert web.ask("GET", "/ticket/1").status_code == 404  # looking does not print
    assert web.ask("POST", "/print", json={"truck": 1}).json() == {"done": True}
    page = web.ask("GET", "/ticket/1?lang=de").text
    assert "Beleg 1" in page
    assert "<svg" in page
    assert "303,0 kg" in page
    assert web.ask("POST", "/print", json={"truck": "x"}).status_code == 409
    assert web.ask("POST", "/zero-total", json={"which": "shift"}).json() == {"done": True}
    assert web.ask("GET", "/history").json()["totals"]["shift"] == []


def test_without_records_the_page_says_so():
    answer = Web().ask("GET", "/history")
    assert (answer.status_code, answer.json()) == (404, {"records": False})


def test_a_client_that_never_reads_delays_nobody():
    """One takes nothing: the other gets every event, and the first is let go."""

    async def main():
        channel, got, stuck = Feed(lambda: {"n": len(got)}), [], asyncio.Event()

        async def take(message):
            if message["type"] == "http.response.body" and message["body"]:
                got.append(message["body"])

        async def never(message):
            if message["type"] == "http.response.body":
                await stuck.wait()

        async def receive():
            await asyncio.Event().wait()

        tasks = [asyncio.create_task(channel({}, receive, send)) for send in (take, never)]
        await asyncio.sleep(0)
        for _ in range(20):
            channel.renew()
            await asyncio.sleep(0.1 * PATIENCE_S)
        clients = channel.clients
        channel.close()
        await asyncio.wait_for(asyncio.gather(*tasks), 1.0)
        return got, clients

    got, clients = run_virtually(main())
    assert len(got) >= 19
    assert clients == 1


def test_the_65th_page_is_refused():
    async def main():
        channel, answers = Feed(dict), []

        async def take(message):
            if message["type"] == "http.response.start":
                answers.append(message["status"])

        async def receive():
            await asyncio.Event().wait()

        tasks = [asyncio.create_task(channel({}, receive, take)) for _ in range(65)]
        await asyncio.sleep(0.1)
        channel.close()
        await asyncio.gather(*tasks)
        return answers

    assert run_virtually(main()) == [200] * 64 + [503]


CALLS = (r"\b(?:t|translate)\(['\"]([^'\"]+)['\"]\)", r'data-t="([^"]+)"', r'massed\("\w+", "([^"]+)"')


def test_every_word_of_the_page_is_known_and_every_known_one_is_used():
    """Those in the scripts, on the ticket and in the terminal's view; some stand in tables and lists there."""
    files = [*STATIC.iterdir(), *(path for path in STATIC.parent.glob("*.py") if path.name != "words.py")]
    text = "\n".join(path.read_text() for path in files)
    asked = {word for call in CALLS for word in re.findall(call, text)}
    quoted = {word for pair in re.findall(r'"([^"\n]+)"|\'([^\'\n]+)\'', text) for word in pair}
    assert {"To the trailer", "Target; 0: none", "Copy", "in all"} <= asked
    assert asked <= set(PAGE), asked - set(PAGE)
    assert set(PAGE) - asked - quoted - {label.capitalize() for label in LABELS} == set()


def test_the_page_itself_has_no_words():
    """They come translated: between its tags stand signs only."""
    text = re.sub(r"<(title)>.*?</\1>", "", (STATIC / "index.html").read_text())
    assert re.findall(r">([^<]*[A-Za-z][^<]*)<", text) == []


def untranslated(say):
    return {text for text in messages() if say(text) == text}


def test_a_forgotten_word_is_found():
    """A catalogue that lacks one of them."""
    say = catalogue("de").gettext
    assert untranslated(lambda text: text if text == "To the trailer" else say(text)) == {"To the trailer"}


@pytest.mark.parametrize("language", [name for name in languages() if name != "en"])
def test_no_word_is_untranslated(language):
    assert untranslated(catalogue(language).gettext) == set()
    assert set(REASONS) == set(Reason)
    assert page_words(language)["language"] == language


@pytest.mark.parametrize("path", sorted(FOLDER.rglob("*.po")), ids=lambda p: p.parts[-3])
def test_the_compiled_catalogue_is_that_of_its_source(path):
    made = BytesIO()
    with path.open("rb") as file:
        write_mo(made, read_po(file))
    made.seek(0)
    compiled, source = (
        {message.id: message.string for message in read_mo(each) if message.id}
        for each in (BytesIO(path.with_suffix(".mo").read_bytes()), made)
    )
    assert compiled == source, "pybabel compile -D display -d src/cylforce/display/locale"


def test_other_computers_need_a_pin(tmp_path):
    with pytest.raises(ValueError, match="changes need a PIN: give --pin-file FILE"):
        read_pin(None, "0.0.0.0")
    short = tmp_path / "pin"
    short.write_text("12\n")
    with pytest.raises(ValueError, match="the PIN is too short"):
        read_pin(short, "0.0.0.0")
    with pytest.raises(ValueError, match="cannot be read"):
        read_pin(tmp_path / "absent", "127.0.0.1")
    assert read_pin(None, "127.0.0.1") == ""
    assert host_and_port("--listen", "[::1]:80") == ("::1", 80)
    with pytest.raises(ValueError, match="is no address: write HOST:PORT"):
        host_and_port("--listen", "8080")


def test_the_pictures_of_its_chapter_are_small():
    for path in Path(STATIC.parent / "docs").glob("*.png"):
        assert path.stat().st_size <= 100_000, path


def test_the_panel_says_when_nobody_answers():
    async def main():
        bus = open_bus("virtual:nobody")
        try:
            return await Display(SERVED, bus).panel.send_command("zero", 0)
        finally:
            bus.close()

    assert asyncio.run(main()) == (False, "no answer")


SERVED = Served(SERVICE, None, "127.0.0.1", 0, (), "", Marks(), "en")
