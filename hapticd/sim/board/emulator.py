"""The complete firmware as a process that contains its plate: firmware/build/hapticd-board.

Runs main.c, the signal chain at 1 MHz and a plate sample by sample, without fingers, parasitic modes and noise. There
are two byte streams: the serial line, and the bench, which reports the plate's ground truth. A board started `stepped`
advances only by `step` and is deterministic.
"""

from __future__ import annotations

import selectors
import socket
import struct
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ...errors import DeviceError, UsageError

CHUNK_US: Final = 50
MODES: Final = 2

_FIRMWARE = Path(__file__).parents[3] / "firmware"  # in a source checkout; a wheel has no firmware to run
_PROGRAM = _FIRMWARE / "build" / "hapticd-board"
_STEP = struct.Struct("<IH")
_REPORT = struct.Struct(f"<IIH{2 * MODES}f")
_ANSWER_WITHIN_S = 30.0
_READ_SIZE = 1 << 16
_SEND_BUFFER = 1 << 20


@dataclass(frozen=True, slots=True)
class BenchReport:
    """Report of the bench at `t_us` of the board's clock.

    `line_bytes` and `steps` count bytes written to the line and completed steps; `plate_um` (M,) are the plate's
    amplitudes in the frame of the nominal drive.
    """

    t_us: int
    line_bytes: int
    steps: int
    plate_um: tuple[complex, ...]


def find_program(given: Path | None = None) -> Path:
    """Return the board's program: `given`, or the source checkout's. Raises UsageError, DeviceError."""
    program = given if given is not None else _PROGRAM
    if program.is_file():
        return program
    if given is not None:
        raise UsageError(f"{given}: there is no such firmware image: build one with `make -C firmware`.")
    raise DeviceError(
        f"{program}: the firmware is not built: in a source checkout, with gcc installed, run `make -C firmware`."
    )


class Emulator:
    """A running board. `line` and `bench` are non-blocking sockets; a stepped board is used through `step`.

    Both must be read: an emulated serial port, and with it the board, blocks until its output is read.
    """

    def __init__(self, program: Path, *, boot_id: int = 1, t_start_us: int = 0, stepped: bool = False) -> None:
        self.line, line_end = _pair()
        self.bench, bench_end = _pair()
        ends = (line_end.fileno(), bench_end.fileno())
        command = [str(program), "--line", str(ends[0]), "--bench", str(ends[1])]
        command += ["--boot-id", str(boot_id & 0xFFFFFFFF), "--start-us", str(t_start_us & 0xFFFFFFFF)]
        try:
            self.process = subprocess.Popen(
                command + ["--stepped"] * stepped, stdin=subprocess.DEVNULL, pass_fds=ends, start_new_session=True
            )
        except OSError as error:
            self.line.close()
            self.bench.close()
            raise DeviceError(
                f"{program}: cannot be run ({error.strerror}): name what `make -C firmware` built."
            ) from None
        finally:
            line_end.close()
            bench_end.close()
        self._partial_report = b""
        self._steps = self._sent = self._received = 0
        self._wait_until_running()

    def __enter__(self) -> Emulator:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Kill the board; it has no state to save."""
        self.process.kill()
        self.process.wait()
        self.line.close()
        self.bench.close()

    def write(self, data: bytes) -> None:
        """Write to the line; bytes that it does not accept are lost."""
        try:
            self._sent += self.line.send(data)
        except BlockingIOError:
            return
        except OSError as error:
            raise self._ended() from error

    def read(self) -> bytes:
        """Read the board's new output without blocking. Raises DeviceError if the board has ended."""
        data = self._receive(self.line)
        self._received += len(data)
        return data

    def reports(self) -> list[BenchReport]:
        """Read the bench's new reports without blocking."""
        data = self._partial_report + self._receive(self.bench)
        whole = len(data) - len(data) % _REPORT.size
        self._partial_report = data[whole:]
        return [_report(values) for values in _REPORT.iter_unpack(data[:whole])]

    def step(self, data: bytes, chunks: int) -> tuple[list[BenchReport], bytes]:
        """Send `data` to a stepped board and run it for `chunks` of 50 us; returns bench reports and output."""
        self.write(data)
        self._steps += 1
        self.bench.sendall(_STEP.pack(self._sent & 0xFFFFFFFF, chunks))
        reports: list[BenchReport] = []
        output = b""
        with selectors.DefaultSelector() as selector:
            selector.register(self.line, selectors.EVENT_READ)
            selector.register(self.bench, selectors.EVENT_READ)
            while not self._has_stepped(reports):
                if not selector.select(_ANSWER_WITHIN_S):
                    raise DeviceError("The emulated board does not answer: its program may have crashed.")
                output += self.read()
                reports += self.reports()
        return reports, output

    def _wait_until_running(self) -> None:
        """Wait for the first report, which marks the ports as open; earlier bytes are lost."""
        try:
            self.bench.settimeout(_ANSWER_WITHIN_S)
            self._partial_report = self.bench.recv(_READ_SIZE)
            self.bench.setblocking(False)
        except OSError:
            self._partial_report = b""
        if not self._partial_report:
            self.close()
            raise DeviceError("The emulated board did not start: see its message above.")

    def _has_stepped(self, reports: list[BenchReport]) -> bool:
        """Return whether the step has ended and all of its output was read."""
        if not reports or reports[-1].steps != self._steps & 0xFFFF:
            return False
        return reports[-1].line_bytes == self._received & 0xFFFFFFFF

    def _receive(self, port: socket.socket) -> bytes:
        try:
            data = port.recv(_READ_SIZE)
        except BlockingIOError:
            return b""
        except OSError as error:
            raise self._ended() from error
        if not data:
            raise self._ended()
        return data

    def _ended(self) -> DeviceError:
        return DeviceError("The emulated board ended: see its message above.")


def _pair() -> tuple[socket.socket, socket.socket]:
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    theirs.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
    return ours, theirs


def _report(values: tuple[float, ...]) -> BenchReport:
    t_us, line_bytes, steps, *re_im = values
    plate_um = tuple(complex(d, q) for d, q in zip(re_im[::2], re_im[1::2], strict=True))
    return BenchReport(int(t_us), int(line_bytes), int(steps), plate_um)
