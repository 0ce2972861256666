"""A new identified file without a restart: `systemctl reload`, or SIGHUP. It is read beside the loop; only one that is
whole and of this machine is taken, between two events. Any other is refused, and the old parameters stay."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import structlog

from cylforce.files.atomic import RecordingError, check_ordinary
from cylforce.files.logfile import file_sha256
from cylforce.programs.common.readings import make_core
from cylforce.programs.live.books import from_elsewhere, sealed_as
from cylforce.programs.live.notify import Manager
from cylforce.service.core import Core
from cylforce.service.service import WeighingService
from cylforce.settings.machine_file import Loaded

NO_FILE = "the service runs without an identified file: start it again with --identified"


class Parameters(NamedTuple):
    """Parameters from an identified file.

    core:      the core with its tares
    sha256:    hash of the file
    seal:      its seal in words
    warnings:  sentences
    elsewhere: whether the file was sealed on another controller
    """

    core: Core
    sha256: str
    seal: str
    warnings: tuple[str, ...]
    elsewhere: bool = False


def read_anew(loaded: Loaded, identified: Path) -> Parameters:
    """Return the present parameters of the file.

    Raises RecordingError, SettingsError or ValueError with a sentence when the file is not whole, not of this machine,
    or replaced meanwhile.
    """
    warnings: list[str] = []
    check_ordinary(identified)
    begun = file_sha256(identified)
    core = make_core(loaded, identified, warnings.append)
    WeighingService.start(core)  # computations made once are made here, beside the loop
    found = Parameters(
        core, file_sha256(identified), sealed_as(identified), tuple(warnings), from_elsewhere(identified)
    )
    if not begun == found.sha256 == file_sha256(identified):
        raise RecordingError(f"{identified}: was replaced while it was read: reload again")
    return found


class Reloading:
    """Reloads of one service. `take` is called in the loop with the new parameters."""

    def __init__(self, loaded: Loaded, identified: Path | None, take: Callable[[Parameters], None]) -> None:
        self._loaded, self._identified, self._take = loaded, identified, take
        self._tell = structlog.get_logger("cylforce")
        self._task: asyncio.Task[None] | None = None
        self._again = False

    def ask(self, manager: Manager) -> None:
        """Reload soon; a request during a reload causes another one afterwards."""
        self._again = True
        if self._task is None or self._task.done():
            self._task = asyncio.get_running_loop().create_task(self._reload(manager))

    async def _reload(self, manager: Manager) -> None:
        manager.reloading()
        while self._again:
            self._again = False
            try:
                self._take(await self._read())
            except (RecordingError, ValueError, OSError) as error:
                self._tell.warning("not reloaded", why=str(error))
        manager.reloaded()

    async def _read(self) -> Parameters:
        if self._identified is None:
            raise RecordingError(NO_FILE)
        return await asyncio.to_thread(read_anew, self._loaded, self._identified)
