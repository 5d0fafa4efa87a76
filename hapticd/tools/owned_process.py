"""A hapticd command as a child process that ends with its owner, however the owner dies.

Its standard input is a pipe that only the owner holds open: when the kernel closes it, the process terminates itself.
"""

from __future__ import annotations

import argparse
import os
import runpy
import select
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

MODULE = "hapticd.tools.owned_process"  # `__name__` is "__main__" in the process itself
READ_SIZE = 4096


def start(
    command: Sequence[str], *, scratch: Path | None = None, stdout: int | None = None, runtime_dir: Path | None = None
) -> subprocess.Popen[str]:
    """Start `hapticd COMMAND...`; `scratch` is a folder of the owner, deleted if the owner dies without cleaning up,
    `runtime_dir` that of a service.

    The process has its own session: a Ctrl-C reaches only the owner, who then ends it and closes its `stdin`. It
    imports nothing from the current directory (-P).
    """
    environment = {} if runtime_dir is None else {"HAPTICD_RUNTIME_DIR": str(runtime_dir)}
    arguments = [] if scratch is None else ["--scratch", str(scratch)]
    return subprocess.Popen(
        [sys.executable, "-P", "-m", MODULE, *arguments, *command],
        env=os.environ | environment,
        stdin=subprocess.PIPE,
        stdout=stdout,
        text=True,
        start_new_session=True,
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command in this process; exits with its exit code."""
    parser = argparse.ArgumentParser(prog=MODULE, description="A hapticd command that ends with its owner.")
    parser.add_argument("--scratch", type=Path, help="folder to delete when the owner has died")
    parser.add_argument("command", nargs=argparse.REMAINDER, help="what follows `hapticd`")
    options = parser.parse_args(arguments)
    owner = sys.stdin.fileno()
    try:
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))  # until the command installs its own handler
        threading.Thread(target=_end_with, args=(owner,), daemon=True).start()
        sys.argv = ["hapticd", *options.command]
        runpy.run_module("hapticd", run_name="__main__", alter_sys=True)  # by name: tools do not import the front door
    finally:
        if options.scratch is not None and select.select([owner], [], [], 0)[0]:  # readable only at end of file
            shutil.rmtree(options.scratch, ignore_errors=True)


def _end_with(owner: int) -> None:
    """Wait until the owner's end of the pipe closes, then terminate this process."""
    while os.read(owner, READ_SIZE):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    main()
