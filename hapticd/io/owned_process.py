"""A command of hapticd as a process that ends with the one which started it, however that dies.

Its standard input is a pipe whose other end only its owner holds: once the kernel closes that, it ends itself.
"""

from __future__ import annotations

import argparse
import os
import select
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

READ_SIZE = 4096


def start(command: Sequence[str], *, forget: Path | None = None, stdout: int | None = None) -> subprocess.Popen[str]:
    """Start `hapticd COMMAND...`; `forget` is a folder of the owner's, deleted if the owner dies without doing that.

    In a session of its own: a Ctrl-C is for the owner, who then ends it, and closes its `stdin`.
    """
    arguments = [] if forget is None else ["--forget", str(forget)]
    return subprocess.Popen(
        [sys.executable, "-m", "hapticd.io.owned_process", *arguments, *command],
        stdin=subprocess.PIPE,
        stdout=stdout,
        text=True,
        start_new_session=True,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """The process itself; returns the command's exit code."""
    parser = argparse.ArgumentParser(
        prog="hapticd.io.owned_process", description="A hapticd command that has an owner."
    )
    parser.add_argument("--forget", type=Path, help="folder to delete when the owner has died")
    parser.add_argument("command", nargs=argparse.REMAINDER, help="what follows `hapticd`")
    options = parser.parse_args(arguments)
    from ..__main__ import main as hapticd

    owner = sys.stdin.fileno()
    try:
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # until the command takes it over
        threading.Thread(target=_end_with, args=(owner,), daemon=True).start()
        return hapticd(options.command)
    finally:
        if options.forget is not None and select.select([owner], [], [], 0)[0]:  # it never writes: this is its end
            shutil.rmtree(options.forget, ignore_errors=True)


def _end_with(owner: int) -> None:
    """Wait for the owner's end, and then end this process as the owner would have."""
    while os.read(owner, READ_SIZE):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    sys.exit(main())
