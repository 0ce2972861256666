"""Texts of the page in the available languages: a language is one folder, locale/LANGUAGE/."""

from gettext import NullTranslations, translation
from importlib.resources import files
from pathlib import Path

from cylforce.signals.estimate import Reason, Status
from cylforce.signals.units import KILOGRAM, MassUnit

DOMAIN = "display"
FOLDER = Path(str(files(__package__) / "locale"))
ENGLISH = "en"

REASONS = {
    Reason.NONE: "",
    Reason.STARTING: "starting: one moment",
    Reason.SIGNAL_MISSING: "a sensor sends nothing",
    Reason.SIGNAL_STALE: "a sensor has stopped sending",
    Reason.OUT_OF_RANGE: "a sensor is out of its range",
    Reason.NOT_A_NUMBER: "a sensor says that it has no value",
    Reason.FROZEN: "a sensor is frozen",
    Reason.IMPLAUSIBLE_JUMP: "a sensor jumps",
    Reason.SHORT_FRAME: "a sensor's message is too short",
    Reason.LONG_FRAME: "a sensor's message is too long",
    Reason.TIME_JUMP: "samples are missing",
    Reason.OVERRUN: "the controller is overloaded",
    Reason.DEAD_POINT: "a cylinder is at its end or dead point: move away",
    Reason.END_STOP: "a cylinder is at its end stop",
    Reason.SINGULAR: "cannot be sensed in this posture: move the arm",
    Reason.AT_REST: "the arm is still: move it a little",
    Reason.IN_CONTACT: "the tool touches something, or the load changes",
    Reason.NOT_A_LOAD: "this is no hanging load",
    Reason.UNCERTAIN: "uncertain: move all joints",
    Reason.OUT_OF_DECLARED_RANGE: "beyond the range of the scale",
    Reason.TILT: "the machine is not level",
    Reason.SLEWING: "the house turns",
    Reason.NOT_OPERATIONAL: "a sensor has restarted",
    Reason.NOT_IDENTIFIED: "not commissioned",
    Reason.NOT_THIS_MACHINE: "parameters of another machine, or a sensor has changed",
    Reason.NOT_CONFIRMED: "parameters from another controller: seal them on this one",
    Reason.NO_CONTACT: "nothing touches the tool",
    Reason.NOT_CURLED: "bucket not curled: nothing is booked",
    Reason.TWO_PRODUCERS: "two nodes send a sensor's message",
    Reason.OWN_IDENTIFIER: "another node sends this scale's messages",
    Reason.SENSORS_DISAGREE: "a sensor is wrong: the others contradict it",
    Reason.OTHER_TOOL: "empty, but off zero: other bucket? dirt? Clean it, or choose the attachment",
}
SILENT = "the service sends nothing"  # instead of a reason
STATUSES = {Status.OK: "OK", Status.DEGRADED: "uncertain", Status.HOLD: "held", Status.INVALID: "no weight"}
REFUSALS = {
    "08000022": "Not done: the weight must be OK now, or the bucket is not among the last ones of this truck.",
    "06090030": "Not done: too large. Empty and clean the bucket, or check the number.",
    "no answer": "Not done: the service does not answer.",
    "unknown": "Not done: there is no such command, or its number is missing or out of range.",
}
# Texts of the page itself: those in static/, which a test compares with this list.
PAGE = (
    "Work", "Engineering", "History", "Night", "Day", "Zero", "Tare", "Target", "Next truck", "Cancel last", "net",
    "gross", "Truck", "Target reached", "remaining", "too much", "Last bucket", "Buckets", "booked", "on disk",
    "Product", "none", "The page gets no data: no weight is shown.",
    "Records have stopped: the disk is full or cannot be written.", "Force at the teeth", "direction", "Signal",
    "Value", "Age", "Reason", "Node", "State", "Emergency", "Bus load", "Cylinder", "Force",
    "Torque not explained by the empty machine", "not seen", "stopped", "operational", "pre-operational", "booting",
    "Time", "Weight", "Status", "Number", "accepted", "cancelled",
    "Ticket", "Number of the product; 0: none", "Print ticket",
    "No bucket of this truck counts: there is no ticket.", "Short total", "Shift total", "Grand total", "Loads",
    "There are no records: start the service with --records.", "PIN", "Done.", "Target; 0: none",
    "Information only: no safety function.", "good", "Set to zero", "OK", "Cancel", "Print", "Copy",
    "Customer", "Job", "Operator", "Note", "Machine", "Total", "rated",
    "Attachment", "of a usual bucket", "tip off", "a full bucket overloads", "Add by hand", "by hand",
    "To the trailer", "Trailer target", "Target of the trailer or next part; 0: none", "part", "in all",
    "Part", "Check zero: empty the bucket, lift it, press Zero", "Mass that was loaded unweighed",
    "Nothing was entered: write a number, or press Cancel.", "This is no number. Write it like this:",
    "The number is negative: write 0 or more.", "Write a whole number.",
)  # fmt: skip


def messages() -> tuple[str, ...]:
    """Return every text that may be shown, in English."""
    listed = (*PAGE, *REASONS.values(), SILENT, *STATUSES.values(), *REFUSALS.values())
    return tuple(dict.fromkeys(text for text in listed if text))


def languages() -> tuple[str, ...]:
    """Return English and all languages that have a folder."""
    return (ENGLISH, *sorted(path.name for path in FOLDER.iterdir() if path.is_dir()))


def catalogue(language: str) -> NullTranslations:
    """Return the translations into a language; English for one that has no folder."""
    return translation(DOMAIN, FOLDER, [language], fallback=True)


def page_words(language: str, unit: MassUnit = KILOGRAM) -> dict[str, object]:
    """Return all words of a page in a language.

    They are texts by their English, reasons and statuses by their codes, refusals by theirs, and the unit of masses.
    """
    translate = catalogue(language).gettext
    return {
        "language": language if language in languages() else ENGLISH,
        "texts": {text: translate(text) for text in messages()},
        "reasons": {int(code): translate(text) if text else "" for code, text in REASONS.items()}
        | {255: translate(SILENT)},
        "statuses": {int(code): translate(text) for code, text in STATUSES.items()},
        "unit": unit._asdict(),
        "refusals": {code: translate(text) for code, text in REFUSALS.items()},
    }


def wanted(accept: str, default: str) -> str:
    """Return the first available language that a browser accepts, else the default.

    accept: value of the browser's accept-language
    """
    for part in accept.split(","):
        language = part.partition(";")[0].strip().partition("-")[0].lower()
        if language in languages():
            return language
    return default
