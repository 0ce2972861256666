"""Seal of identified.toml: a hash of every key, by which an edited value is detected and named.

It proves that nothing was changed by mistake, by a broken disk, or by an editor. It is no signature: whoever can write
the file can seal it, which `cylforce seal` does, with a reason that stays in the file and in the audit trail.
"""

import getpass
import hashlib
import json
from collections.abc import Mapping

from pydantic import BaseModel, ConfigDict, JsonValue


class Seal(BaseModel):
    """The seal of a file.

    counter: grows with every seal
    date: date of the seal
    who: user who sealed it
    reason: reason for the seal
    before: hash of the seal before; "": none
    keys: SHA-256 of each key of the file
    controller: controller on which it was sealed (`files.software`); "": unknown
    sha256: hash of all these
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    counter: int
    date: str
    who: str
    reason: str
    before: str
    keys: dict[str, str]
    controller: str = ""
    sha256: str


def sealed(
    content: Mapping[str, JsonValue],
    before: Seal | None,
    date: str,
    reason: str,
    who: str | None = None,
    controller: str = "",
) -> Seal:
    """Return the seal of a file's content.

    content: value of each key of the file, without the seal
    before: the seal that it replaces; None: none
    who: user; None: the user of this program
    controller: identification of the controller
    """
    keys = {key: _hash(value) for key, value in content.items()}
    number, earlier = (1, "") if before is None else (before.counter + 1, before.sha256)
    seal = Seal(
        counter=number,
        date=date,
        who=user() if who is None else who,
        reason=reason,
        before=earlier,
        keys=keys,
        controller=controller,
        sha256="",
    )
    return seal.model_copy(update={"sha256": _seal_hash(seal)})


def broken(content: Mapping[str, JsonValue], seal: Seal) -> tuple[str, ...]:
    """Return the keys that were changed, added or removed since the seal; only "seal" when the seal itself was changed.

    content: value of each key of the file, without the seal
    """
    if _seal_hash(seal) != seal.sha256:
        return ("seal",)
    names = sorted(content.keys() | seal.keys.keys())
    return tuple(key for key in names if key not in content or _hash(content[key]) != seal.keys.get(key))


def _seal_hash(seal: Seal) -> str:
    """Return the hash of everything in a seal. Older seals have no controller."""
    return _hash(seal.model_dump(mode="json", exclude={"sha256"} if seal.controller else {"sha256", "controller"}))


def user() -> str:
    """Return the name of the user who runs this program."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user without a name, as in a container
        return "unknown"


def _hash(value: object) -> str:
    """Return the SHA-256 of a value as JSON."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
