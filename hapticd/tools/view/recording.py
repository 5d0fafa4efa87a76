"""The page's Record button: `hapticd record` as a process of the viewer, into a file of its working directory."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from . import messages

END_WITHIN_S = 5.0  # for the file's last chunk and index
MIDWAY = "It began while the service ran: draw and export it; `hapticd record` makes one that replays bit for bit."


class PageRecording:
    """At most one recording at a time, for all pages; `publish` gets each change as a message."""

    def __init__(self, endpoint: str | None, publish: Callable[[str], None]) -> None:
        self._endpoint = endpoint
        self._publish = publish
        self._task: asyncio.Task[None] | None = None
        self._process: asyncio.subprocess.Process | None = None
        self._is_wanted = False

    @property
    def is_on(self) -> bool:
        return self._task is not None and not self._task.done()

    def request(self, *, is_on: bool) -> None:
        """Start a recording, or end the one that runs."""
        self._is_wanted = is_on
        if is_on and not self.is_on:
            self._task = asyncio.ensure_future(self._record(file_of(datetime.now())))
        elif not is_on and self._process is not None:
            with suppress(ProcessLookupError):
                self._process.send_signal(signal.SIGINT)

    async def close(self) -> None:
        """End what runs, and return when its file is whole."""
        self.request(is_on=False)
        if self._task is not None:
            await asyncio.wait((self._task,), timeout=END_WITHIN_S)
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.kill()

    async def _record(self, file: Path) -> None:
        command = [sys.executable, "-P", "-m", "hapticd", "record", str(file), "--now"]
        command += [] if self._endpoint is None else ["--endpoint", self._endpoint]
        pipe = asyncio.subprocess.PIPE
        self._process = await asyncio.create_subprocess_exec(*command, stdout=pipe, stderr=asyncio.subprocess.STDOUT)
        self._publish(messages.recording(str(file), is_on=True))
        if not self._is_wanted:  # pressed again meanwhile
            self.request(is_on=False)
        said, _ = await self._process.communicate()
        is_made, self._process = self._process.returncode == 0, None
        lines = said.decode(errors="replace").strip().splitlines()
        sentence = ". ".join([*lines[-1:], *([MIDWAY] if is_made else [])])
        self._publish(messages.recording(str(file), is_on=False, sentence=sentence))


def file_of(now: datetime) -> Path:
    """Return the path of a recording that begins now."""
    return Path(f"plate-{now:%Y%m%d-%H%M%S}.mcap").resolve()
