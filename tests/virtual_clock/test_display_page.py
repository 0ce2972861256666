"""The page in headless Chromium, with service, simulated machine and display as processes on a kernel's bus. On the
virtual clock computing costs no time, so a slow machine takes longer and shows the same."""

import json
import shutil
import signal
import subprocess
import sys
import time
import urllib.request

import pytest
from playwright.sync_api import sync_playwright

from cylforce.commissioning.identification import identify
from cylforce.programs.common.readings import model_of
from cylforce.settings.identified import write_identified
from cylforce.settings.machine_file import load
from scenarios import EXCAVATOR, GRAB, moved

BUS = "socketcan:vcan0"
COMMAND = (sys.executable, "-m", "cylforce")
PORT = 8181
ADDRESS = f"http://127.0.0.1:{PORT}"
# Each process of the browser takes seconds to start in a guest.
LIGHT = ["--no-sandbox", "--disable-gpu", "--in-process-gpu", "--renderer-process-limit=1"]
MM = 96.0 / 25.4  # pixels of a millimetre, as CSS has it
WAIT_S = 60.0  # for what is certain to come: four digging cycles


class Cab:
    """The programs of a cab."""

    def __init__(self, folder):
        self.machine, self.tares, self.records = folder / "machine.toml", folder / "tares.toml", folder / "records.db"
        text = EXCAVATOR.read_text().replace("rate_hz = 100", "rate_hz = 50")  # half the frames
        self.machine.write_text(text + GRAB)
        loaded = load(self.machine)
        assert loaded.service.filters.rate_hz == 50
        write_identified(self.tares, identify(model_of(loaded), [moved(loaded)]), loaded, [])
        self.running, self.folder = {}, folder

    def start(self, name, *words):
        words = [*COMMAND, *map(str, words)]
        with (self.folder / f"{name}.err").open("w") as err:
            self.running[name] = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=err)

    def start_all(self):
        self.start("run", "run", self.machine, "--bus", BUS, "--identified", self.tares, "--records", self.records)
        self.start("sim", "sim", self.machine, "--bus", BUS, "--cycles", 200, "--seed", 3)
        where = ("--records", self.records, "--listen", f"127.0.0.1:{PORT}")
        self.start("display", "display", self.machine, "--bus", BUS, *where)

    def stop(self, name):
        process = self.running.pop(name)
        begun = time.monotonic()
        process.terminate()
        process.wait(20)
        return process.returncode, time.monotonic() - begun


@pytest.fixture(scope="module")
def cab(tmp_path_factory):
    made = Cab(tmp_path_factory.mktemp("cab"))
    made.start_all()
    yield made
    for name in list(made.running):
        made.stop(name)


def wait_for_server():
    for _ in range(300):
        try:
            return urllib.request.urlopen(f"{ADDRESS}/words", timeout=5).read()
        except OSError:
            time.sleep(0.2)
    raise TimeoutError("the display does not answer")


@pytest.fixture(scope="module")
def browser(cab):
    program = shutil.which("chromium") or shutil.which("chromium-browser")
    assert program, "chromium is missing: apt-get install chromium"
    wait_for_server()
    with sync_playwright() as driver:
        found = driver.chromium.launch(executable_path=program, args=LIGHT)
        yield found
        found.close()


def go_to(shown):
    """Opens the page and waits for its first picture: before that it answers no click."""
    shown.set_default_timeout(1e3 * WAIT_S)
    shown.goto(ADDRESS)
    shown.wait_for_selector("#arm polygon", state="attached")


@pytest.fixture(scope="module")
def opened(browser):
    """The page in English, and what stands in its console; opened once, because that takes seconds."""
    context = browser.new_context(locale="en-GB", viewport={"width": 1180, "height": 700})
    shown, errors = context.new_page(), []
    shown.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    shown.on("pageerror", lambda error: errors.append(str(error)))
    go_to(shown)
    yield shown, errors
    context.close()


@pytest.fixture
def page(opened):
    """The page at the operator's part; at a test's end nothing may stand in the console."""
    shown, errors = opened
    if "/ticket/" in shown.url:
        go_to(shown)
    shown.click("nav a[href='#work']")
    yield shown
    assert [line for line in errors if "409" not in line and "ERR_" not in line] == []


def until(question, seconds=WAIT_S):
    end = time.monotonic() + seconds
    while not (found := question()):
        assert time.monotonic() < end, "did not come"
        time.sleep(0.05)
    return found


def answered(page):
    until(lambda: page.text_content("#answer"))
    return page.text_content("#answer")


SHOWN = """() => {
    const at = (id) => document.getElementById(id);
    return [at("weight").classList.contains("words"), at("weight").textContent, at("status").textContent];
}"""


def test_a_weight_is_a_number_only_while_it_is_valid(page):
    """At every moment either a number with its error, or a reason without a digit. Both are seen."""
    seen = set()

    def both():
        words, text, status = page.evaluate(SHOWN)
        assert any(letter.isdigit() for letter in text) is not words, text
        assert words or "kg ±" in text
        assert words is (status in ("no weight", "")), status
        seen.add(words)
        return len(seen) == 2

    until(both)


def test_target_truck_and_cancel(page):
    page.click("#target")
    page.fill("#entry", "4000")
    page.click("menu button[value=yes]")
    assert answered(page) == "Done."
    until(lambda: "/ 4,000 kg" in page.text_content("#truck-text"))
    until(lambda: "Buckets: 0" not in page.text_content("#truck-text"))
    page.click("#cancel")
    assert answered(page) == "Done."
    until(lambda: "Buckets: 0" in page.text_content("#truck-text"), 10.0)  # before the next bucket comes
    page.click("[data-command=next]")
    until(lambda: "Truck 2: " in page.text_content("#truck-text"))


def test_zero_is_refused_in_words_while_digging(page):
    page.wait_for_selector("#weight.words")
    page.click("[data-command=zero]")
    assert answered(page).startswith(("Not done: the weight must be OK now", "Done.", "Not done: too large"))


def test_tare_by_button(page):
    """Net is near zero then, gross stays. The weight may stop being OK while the button is pressed: then once more."""

    def tared():
        page.wait_for_selector("#status.s0")
        page.click("[data-command=tare]")
        return answered(page) == "Done."

    until(tared)


def test_the_product_is_chosen_by_its_number(page):
    page.click("#product")
    page.fill("#entry", "3")
    page.click("menu button[value=yes]")
    until(lambda: "Product 3" in page.text_content("#truck-text"))


LOADED = """() => {
    const text = (id) => document.getElementById(id).textContent;
    return /^Truck 2: .*Buckets: [1-9]/s.test(text("truck-text")) && text("saved").includes("on disk");
}"""


def test_history_and_ticket(page, cab):
    """Once a bucket of truck 2 is in the truck and on the disk."""
    page.wait_for_function(LOADED)
    page.click("nav a[href='#history']")
    page.wait_for_selector("#bookings tr")
    assert page.text_content("#bookings tr:first-child td:nth-child(3)") == "2"
    page.click("#bookings tr:last-child button")  # truck 1, whose one bucket was cancelled
    page.wait_for_selector("#no-records:not(:empty)")
    assert page.text_content("#no-records") == "No bucket of this truck counts: there is no ticket."
    page.click("#bookings tr:first-child button")
    page.wait_for_selector("svg.qr")
    assert page.text_content("h1").startswith("Ticket 1")


RATED = """() => new Promise((done) => {
    const stream = new EventSource("/stream/work");
    stream.onmessage = (event) => { stream.close(); done(JSON.parse(event.data).rated); };
})"""


def test_the_attachment_is_changed_and_changed_back(page):
    """The service says which one it has: the rated payload is the grab's then, and the box follows."""
    for number, rated in ((1, 1300.0), (0, 1500.0)):
        page.select_option("#attachment", str(number))
        assert answered(page) == "Done."
        until(lambda rated=rated: page.evaluate(RATED) == rated)
        until(lambda number=number: page.evaluate("document.getElementById('attachment').value") == str(number))


def test_buttons_are_for_gloves(page):
    pressed = "#work button, #work select, nav button, nav a"
    for box in [button.bounding_box() for button in page.query_selector_all(pressed)]:
        assert min(box["width"], box["height"]) >= 12.0 * MM


def test_a_number_that_cannot_be_read_changes_nothing(page):
    """The dialog stays open, says why and shows the value that holds. Cancelled, it sends nothing."""
    page.click("#product")
    page.fill("#entry", "7")
    page.click("menu button[value=yes]")
    until(lambda: "Product 7" in page.text_content("#truck-text"))
    page.click("#product")
    assert page.input_value("#entry") == "7"
    for entry, complaint in (("", "Nothing was entered"), ("seven", "This is no number"), ("2.5", "whole number")):
        page.fill("#entry", entry)
        page.click("menu button[value=yes]")
        assert complaint in page.text_content("#complaint")
    page.click("menu button[value=no]")
    assert not page.is_visible("#ask")
    assert "Product 7" in page.text_content("#truck-text")


def test_night_and_german(browser):
    """A German number has a point between its thousands."""
    shown = browser.new_page(locale="de-DE")
    go_to(shown)
    shown.click("#target")
    shown.fill("#entry", "1.500")
    shown.click("menu button[value=yes]")
    until(lambda: "/ 1.500 kg" in shown.text_content("#truck-text"))
    shown.click("#target")
    assert shown.input_value("#entry") == "1500"
    shown.keyboard.press("Escape")
    shown.click("#night")
    assert "night" in shown.get_attribute("body", "class")
    assert shown.text_content("#night") == "Tag"
    assert shown.get_attribute("html", "lang") == "de"
    shown.close()


def test_the_phone_needs_no_scrolling_sideways(page):
    before = page.viewport_size
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("window.innerWidth") == 390
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    page.set_viewport_size(before)


def test_the_engineering_page_lists_every_signal_and_node(page, cab):
    page.click("nav a[href='#engineering']")
    page.wait_for_selector("#signals tr")
    service = load(cab.machine).service
    assert len(page.query_selector_all("#signals tr")) == len(service.machine.signals)
    page.wait_for_selector("#cylinders tr:nth-child(3) td:nth-child(3):has-text('N m')")
    assert len(page.query_selector_all("#nodes tr")) == len(service.nodes) + 1
    assert "kbit/s" in page.text_content("#load")


def frozen(page, cab):
    """Stops the display while a weight is shown and the page's clock stands still. Whether the weight stayed."""
    page.wait_for_selector("#weight:not(.words)")
    cab.running["display"].send_signal(signal.SIGSTOP)
    time.sleep(0.5)  # for what was on its way
    stayed = not page.evaluate(SHOWN)[0]
    if not stayed:
        cab.running["display"].send_signal(signal.SIGCONT)
    return stayed


def test_a_frozen_display_blanks_the_weight_within_a_second(page, cab):
    """By the page's own clock, which is set by hand."""
    page.clock.install()
    go_to(page)
    page.clock.pause_at(page.evaluate("Date.now()") + 3_600_000)
    until(lambda: frozen(page, cab))
    try:
        page.clock.run_for(500)
        assert not page.evaluate(SHOWN)[0]
        page.clock.run_for(500)
        assert page.text_content("#weight") == "The page gets no data: no weight is shown."
    finally:
        cab.running["display"].send_signal(signal.SIGCONT)
        page.clock.resume()
    page.wait_for_selector("#weight:not(.words)")


def test_open_pages_do_not_hold_up_the_end(opened, page, cab):
    """Nor the service's; what was booked is on the disk then. A server that ends may still refuse a page with 503."""
    _, errors = opened
    _, seconds = cab.stop("display")
    assert seconds < 5.0
    assert cab.stop("run")[0] == 0
    listed = subprocess.run([*COMMAND, "records", "telematics", cab.records], stdout=subprocess.PIPE, check=True)
    assert json.loads(listed.stdout)["CumulativeLoadCount"]["Count"] >= 1
    page.wait_for_selector("#weight.words")
    errors[:] = [line for line in errors if "503" not in line]
