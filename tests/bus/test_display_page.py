"""The page in headless Chromium, with service, simulated machine and display as processes on a real bus."""

import json
import os
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
from scenarios import EXCAVATOR, moved

BUS = os.environ.get("CYLFORCE_PAGE_BUS", "socketcan:vcan0")
COMMAND = (sys.executable, "-m", "cylforce")
PORT = 8181
ADDRESS = f"http://127.0.0.1:{PORT}"
MM = 96.0 / 25.4  # pixels of a millimetre, as CSS has it
WAIT_MS = 90_000


class Cab:
    """The programs of a cab."""

    def __init__(self, folder):
        self.machine, self.tares, self.records = EXCAVATOR, folder / "identified.toml", folder / "records.db"
        loaded = load(EXCAVATOR)
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
        found = driver.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        yield found
        found.close()


@pytest.fixture
def page(browser):
    """The page in English; at its end nothing may stand in the console."""
    context = browser.new_context(locale="en-GB", viewport={"width": 1180, "height": 700})
    opened, errors = context.new_page(), []
    opened.set_default_timeout(WAIT_MS)
    opened.on("console", lambda line: errors.append(line.text) if line.type == "error" else None)
    opened.on("pageerror", lambda error: errors.append(str(error)))
    opened.goto(ADDRESS)
    opened.wait_for_selector("#arm polygon", state="attached")
    yield opened
    context.close()
    assert [line for line in errors if "409" not in line and "ERR_" not in line] == []


def until(question, seconds=60.0):
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

    until(both, 90.0)


def test_target_truck_and_cancel(page):
    page.click("#target")
    page.fill("#entry", "4000")
    page.click("menu button[value=yes]")
    assert answered(page) == "Done."
    until(lambda: "/ 4,000 kg" in page.text_content("#truck-text"))
    until(lambda: "Buckets: 0" not in page.text_content("#truck-text"))
    before = page.text_content("#truck-text")
    page.click("#cancel")
    until(lambda: page.text_content("#truck-text") != before)
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

    until(tared, 120.0)


def test_the_product_is_chosen_by_its_number(page):
    page.click("#product")
    page.fill("#entry", "3")
    page.click("menu button[value=yes]")
    until(lambda: "Product 3" in page.text_content("#truck-text"))


def loaded_truck(page):
    """The truck of the newest booking, as the history shows it anew."""
    page.reload()
    page.wait_for_selector("#bookings tr")
    return page.text_content("#bookings tr:first-child td:nth-child(3)")


def test_history_and_ticket(page, cab):
    until(lambda: "on disk" in page.text_content("#saved"))
    page.goto(f"{ADDRESS}/#history")
    page.wait_for_selector("#bookings tr")
    page.click("#bookings tr:last-child button")  # truck 1, whose one bucket was cancelled
    page.wait_for_selector("#no-records:not(:empty)")
    assert page.text_content("#no-records") == "No bucket of this truck counts: there is no ticket."
    until(lambda: loaded_truck(page) == "2")
    page.click("#bookings tr:first-child button")
    page.wait_for_selector("svg.qr")
    assert page.text_content("h1").startswith("Ticket 1")


def test_buttons_are_for_gloves(page):
    for box in [button.bounding_box() for button in page.query_selector_all("#work button, nav button, nav a")]:
        assert min(box["width"], box["height"]) >= 12.0 * MM


def test_night_and_german(browser):
    opened = browser.new_page(locale="de-DE")
    opened.goto(ADDRESS)
    opened.click("#night")
    assert "night" in opened.get_attribute("body", "class")
    assert opened.text_content("#night") == "Tag"
    assert opened.get_attribute("html", "lang") == "de"
    opened.close()


def test_the_phone_needs_no_scrolling_sideways(browser):
    opened = browser.new_page(viewport={"width": 390, "height": 844})
    opened.goto(ADDRESS)
    opened.wait_for_selector("#arm polygon", state="attached")
    assert opened.evaluate("document.documentElement.scrollWidth") <= 390
    opened.close()


def test_the_engineering_page_lists_every_signal_and_node(page):
    page.goto(f"{ADDRESS}/#engineering")
    page.wait_for_selector("#signals tr")
    service = load(EXCAVATOR).service
    assert len(page.query_selector_all("#signals tr")) == len(service.machine.signals)
    assert len(page.query_selector_all("#nodes tr")) == len(service.nodes) + 1
    assert "kbit/s" in page.text_content("#load")


def test_a_frozen_display_blanks_the_weight_within_a_second(page, cab):
    page.wait_for_selector("#weight:not(.words)")
    cab.running["display"].send_signal(signal.SIGSTOP)
    begun = time.monotonic()
    try:
        until(lambda: page.text_content("#weight") == "The page gets no data: no weight is shown.", 5.0)
        assert time.monotonic() - begun < 1.5  # a second, and what the driver takes to ask
    finally:
        cab.running["display"].send_signal(signal.SIGCONT)
    page.wait_for_selector("#weight:not(.words)")


def test_open_pages_do_not_hold_up_the_end(page, cab):
    """Nor the service's; what was booked is on the disk then."""
    _, seconds = cab.stop("display")
    assert seconds < 5.0
    assert cab.stop("run")[0] == 0
    listed = subprocess.run([*COMMAND, "records", "telematics", cab.records], stdout=subprocess.PIPE, check=True)
    assert json.loads(listed.stdout)["CumulativeLoadCount"]["Count"] >= 1
    page.wait_for_selector("#weight.words")
