"""`hapticd gateway` as a process, and the files of the JavaScript client on a server of their own."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

JAVASCRIPT = Path(__file__).parents[2] / "clients" / "javascript"


@contextmanager
def gateway_process(folder: Path, *origins: str) -> Iterator[str]:
    """Yield the address of a gateway of the daemon in this folder."""
    allowed = [word for origin in origins for word in ("--origin", origin)]
    command = [sys.executable, "-m", "hapticd", "gateway", "--port", "0", "--endpoint", str(folder), *allowed]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    try:
        yield process.stdout.readline().partition(": ")[2].strip()
    finally:
        process.terminate()
        process.communicate(timeout=30)
    assert process.returncode == 0


class _Files(SimpleHTTPRequestHandler):
    extensions_map = {**SimpleHTTPRequestHandler.extensions_map, ".js": "text/javascript"}  # noqa: RUF012

    def log_message(self, *_: object) -> None:
        """Stay quiet."""


@contextmanager
def served_files() -> Iterator[str]:
    """Yield the origin at which the files of the JavaScript client are."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Files, directory=str(JAVASCRIPT)))
    serving = threading.Thread(target=server.serve_forever)
    serving.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        serving.join()
        server.server_close()


def node_command() -> list[str]:
    """The command of Node with a WebSocket."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    version = int(subprocess.run([node, "--version"], capture_output=True, text=True).stdout.lstrip("v").split(".")[0])
    if version < 20:
        pytest.skip(f"node {version} has no WebSocket")
    return [node, *["--experimental-websocket"] * (version < 22)]


def run_node(script: str, *arguments: str) -> str:
    """Run a module in Node, with hapticd.js as `hapticd`; return what it printed."""
    code = f"import * as hapticd from {str((JAVASCRIPT / 'hapticd.js').as_uri())!r};\n{script}"
    command = [*node_command(), "--no-warnings", "--input-type=module", "-", *arguments]
    done = subprocess.run(command, input=code, capture_output=True, text=True, timeout=100, env={**os.environ})
    assert done.returncode == 0, done.stderr
    return done.stdout
