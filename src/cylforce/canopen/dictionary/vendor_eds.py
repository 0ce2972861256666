"""Read a vendor's EDS file with the canopen library. Common mistakes are corrected before, others are refused."""

import io
import re
from configparser import Error as ConfigError
from configparser import RawConfigParser
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:  # imported where a file is read: few machines have one, and all load this
    from canopen.objectdictionary import ODVariable

CODES = {2: "b", 3: "h", 4: "i", 5: "B", 6: "H", 7: "I", 8: "f"}  # CiA 301 data type: struct code, if a PDO may have it
OBJECT = re.compile(r"[0-9A-Fa-f]{4}(sub[0-9A-Fa-f]+)?", re.IGNORECASE)  # sections that describe an object
NUMBERS = ("VendorNumber", "ProductNumber", "RevisionNumber")  # keys of [DeviceInfo] that the library needs
TEXTS = ("VendorName", "ProductName", "OrderCode", "ParameterName")  # keys whose values are text, not numbers


class EdsError(ValueError):
    """An EDS file that cannot be used; its text is one sentence that names the file and the cure."""


class Eds(NamedTuple):
    """A vendor's object dictionary.

    name: name of its file
    dictionary: a canopen.ObjectDictionary
    """

    name: str
    dictionary: Any  # canopen.ObjectDictionary, which is not imported here


def read(path: Path) -> Eds:
    """Read the dictionary of an EDS file. Raises EdsError."""
    from canopen import import_od

    parser = _parsed(path)
    if not parser.has_section("DeviceInfo"):
        raise EdsError(
            f"{path.name} has no section [DeviceInfo], so it describes no device: ask its vendor for the EDS"
        )
    _correct(parser)
    text = io.StringIO()
    parser.write(text)
    text.name = f"{path.stem}.eds"  # the library chooses the format by the ending of the name
    text.seek(0)
    try:
        dictionary = import_od(text)
    except (ValueError, KeyError, IndexError, AttributeError, TypeError, ConfigError) as error:
        raise EdsError(f"{path.name} cannot be interpreted ({error}): ask its vendor for a correct one") from error
    if 0x1000 not in dictionary:
        raise EdsError(f"{path.name} lacks object 1000h, the device type: ask its vendor for a complete EDS")
    return Eds(path.name, dictionary)


def _parsed(path: Path) -> RawConfigParser:
    """Return sections and keys of the file. Raises EdsError."""
    parser = RawConfigParser(inline_comment_prefixes=(";",))
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    try:
        parser.read_string(_text(path))
    except OSError as error:
        raise EdsError(f"{path} cannot be read ({error.strerror}): correct the path") from error
    except ConfigError as error:
        reason = str(error).replace("\n", " ").replace("'<string>'", path.name)
        raise EdsError(f"{path.name} is no EDS file ({reason}): ask its vendor for a correct one") from error
    return parser


def _text(path: Path) -> str:
    """Return the text of a file. EDS files should be ASCII (CiA 306); vendors write UTF-8 or an 8-bit code as well."""
    data = path.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _correct(parser: RawConfigParser) -> None:
    """Correct entries that the library refuses: inline comments, numbers with leading zeros or none at all, a missing
    AccessType.

    Drop sections that are not needed and are often wrong.
    """
    for section in ("Comments", "DeviceComissioning"):
        parser.remove_section(section)
    for section in parser.sections():
        for key, value in parser.items(section):
            if key not in TEXTS:
                parser.set(section, key, _number(value))
        if OBJECT.fullmatch(section) and parser.has_option(section, "DataType"):
            parser.set(section, "AccessType", parser.get(section, "AccessType", fallback="") or "ro")
    for key in NUMBERS:
        if not parser.get("DeviceInfo", key, fallback=""):
            parser.set("DeviceInfo", key, "0")


def _number(value: str) -> str:
    """Return a value without an inline comment and, for a number, without leading zeros."""
    bare = value.split(" #", maxsplit=1)[0].strip()
    return bare.lstrip("0") or "0" if re.fullmatch(r"0\d+", bare) else bare


def profile(eds: Eds) -> int:
    """Return the number of the device profile (404: CiA 404), 0 for none."""
    default = getattr(eds.dictionary[0x1000], "default", None)
    return default & 0xFFFF if isinstance(default, int) else 0


def mapped_code(eds: Eds, index: int, sub: int) -> str:
    """Return the struct code of an object's type.

    Raises EdsError where the object does not exist, may not be mapped into a PDO, or has no type of 8, 16 or 32 bits.
    """
    place = f"{index:04X}h:{sub}"
    variable = eds.dictionary.get_variable(index, sub)
    if variable is None or not _described(eds, index, sub):
        raise EdsError(f"{eds.name} has no object {place}: correct index or sub-index")
    if not variable.pdo_mappable:
        raise EdsError(f"{eds.name} does not let {place} ({variable.name}) be mapped into a PDO: choose another object")
    if variable.data_type not in CODES:
        raise EdsError(f"{eds.name} gives {place} data type {variable.data_type:04X}h: choose one of 8, 16 or 32 bits")
    return CODES[variable.data_type]


def _described(eds: Eds, index: int, sub: int) -> bool:
    """Return whether the file describes a sub-index; the library invents further members of an array."""
    from canopen.objectdictionary import ODArray

    entry = eds.dictionary[index]
    count = _default(eds.dictionary.get_variable(index, 0))
    return not isinstance(entry, ODArray) or sub in entry.subindices or sub <= count


def default_mapping(eds: Eds, number: int) -> tuple[tuple[int, int, int], ...]:
    """Return the default mapping of TPDO `number`, from 1, as (index, sub-index, length [bits]) of each object."""
    count = _default(eds.dictionary.get_variable(0x1A00 + number - 1, 0))
    entries = (_default(eds.dictionary.get_variable(0x1A00 + number - 1, k)) for k in range(1, count + 1))
    return tuple((entry >> 16, entry >> 8 & 0xFF, entry & 0xFF) for entry in entries)


def _default(variable: "ODVariable | None") -> int:
    """Return the default of a numeric object, 0 where there is none."""
    default = getattr(variable, "default", None)
    return default if isinstance(default, int) else 0
