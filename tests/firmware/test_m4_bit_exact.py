"""The core on a Cortex-M4 and on this machine: the same calls, the same bits.

Both start from what the board's own `board_start` says of itself. The plate between the calls is a stand-in, one pole
per mode: it only has to keep every branch of the controller busy.
"""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable

import numpy as np
import pytest

from hapticd.board_protocol import ClearFault, HelloRequest
from hapticd.board_values import SetController
from hapticd.sim.board.firmware import load
from hapticd.values import Knot, LimitReason, SafeDrive
from hapticd.wire import device
from hapticd.wire.commands import encode

from .m4.boards import G474, H743, every_board, needs_compiler
from .m4.chip import Chip
from .m4.cpu import SCRATCH, Cpu
from .test_golden import SCRIPT

pytestmark = [pytest.mark.long, needs_compiler]

TICK_US = 500
CONFIG_SIZE, OBJECT_SIZE, LINE_SIZE = 4096, 0xC000, 2048
CONFIG, CONVERTERS, OBJECT, IN, OUT = (SCRATCH + 0x10000 * i for i in range(5))
CHUNK = 50
EXTREMES = (0.0, -0.0, 1e-45, -1e-40, 3.4e38, -3.4e38, 1e19, np.inf, -np.inf, np.nan, 4.0, 6.0000005)


def fresh_cpu(board: Chip) -> Cpu:
    registers = board.registers()
    cpu = Cpu(board, board.image(), read=registers.read, write=registers.write)
    assert cpu.run_to("main")
    cpu.call("board_start", CONFIG, CONVERTERS)
    return cpu


class Twins:
    """One object of the core, twice; every call goes to both and returns what both say, or fails."""

    def __init__(self, board: Chip, init: str, argument: int, *extra: int) -> None:
        self.cpu = fresh_cpu(board)
        self.modes = board.modes
        self.host = load(board.modes)
        given = ctypes.create_string_buffer(self.cpu.read(argument, CONFIG_SIZE), CONFIG_SIZE)
        self.object = ctypes.create_string_buffer(OBJECT_SIZE)
        assert self.cpu.call(init, OBJECT, argument, *extra) & 0xFF == 1
        getattr(self.host, init).restype = ctypes.c_bool
        assert getattr(self.host, init)(self.object, given, *map(ctypes.c_uint32, extra))

    def call(self, name: str, *arguments: int | bytes, out: int = 0) -> tuple[bytes, int]:
        """Arguments in order: integers, and bytes to read; last comes room for `out` bytes. Returns these and r0."""
        target: list[int] = []
        for value in arguments:
            if isinstance(value, bytes):
                self.cpu.write(IN, value)
            target.append(IN if isinstance(value, bytes) else value)
        self.cpu.write(OUT, bytes(out))
        result = self.cpu.call(name, OBJECT, *target, *([OUT] if out else []))
        written = ctypes.create_string_buffer(out)
        host = [ctypes.c_uint32(value) if isinstance(value, int) else value for value in arguments]
        getattr(self.host, name)(self.object, *host, *([written] if out else []))
        assert self.cpu.read(OUT, out) == written.raw
        return written.raw, result

    def transmit(self, now_us: int) -> bytes:
        self.cpu.write(OUT, bytes(LINE_SIZE))
        n = self.cpu.call("hd_transmit", OBJECT, now_us, OUT, LINE_SIZE)
        written = ctypes.create_string_buffer(LINE_SIZE)
        self.host.hd_transmit.restype = ctypes.c_size_t
        size = ctypes.c_size_t(LINE_SIZE)
        assert n == self.host.hd_transmit(self.object, ctypes.c_uint32(now_us), written, size)
        assert self.cpu.read(OUT, n) == written.raw[:n]
        return written.raw[:n]

    def receive(self, line: bytes, now_us: int) -> None:
        self.cpu.write(IN, line)
        self.cpu.call("hd_receive", OBJECT, IN, len(line), now_us)
        self.host.hd_receive.restype = None
        self.host.hd_receive(self.object, line, ctypes.c_size_t(len(line)), ctypes.c_uint32(now_us))

    def tick(self, now_us: int, measured_um: np.ndarray) -> np.ndarray:
        values, _ = self.call("hd_tick", now_us, measured_um.astype("<f4").tobytes(), out=8 * self.modes)
        return np.frombuffer(values, dtype="<f4")


def polyline(rng: np.random.Generator, seq: int, now_us: int, modes: int) -> bytes:
    offsets_ms = np.cumsum(np.r_[0, rng.uniform(0.1, 6, rng.integers(0, 8))])
    amplitudes = rng.normal(0, 1.6, (len(offsets_ms), modes)) + 1j * rng.normal(0, 0.4, (len(offsets_ms), modes))
    knots = tuple(Knot(round(1e6 * t), tuple(w)) for t, w in zip(offsets_ms, amplitudes, strict=True))
    t_apply_us = now_us + int(rng.integers(-2000, 10000))
    return device.encode_reference(seq, SafeDrive(0, knots, LimitReason.NONE), t_apply_us & 0xFFFFFFFF)


SOMETHING_ELSE = [encode(step) for step in SCRIPT if not isinstance(step, (int, np.ndarray))] + [b"\x07noise\0"]


@every_board
@pytest.mark.parametrize("law", ["pi", "pi_ff", "deadbeat"])
def test_control_ticks_and_frames_give_the_same_bits(board: Chip, law: str) -> None:
    """2500 ticks that follow random polylines on plates of random damping, across the wrap of the clock; now and then
    sensors say what none gives."""
    rng = np.random.default_rng(7)
    now_us = 2**32 - 600_000
    twins, n = Twins(board, "hd_init", CONFIG, now_us), board.modes
    twins.receive(encode(SetController(law)), now_us)
    plate_um, pole, seq, driven, said = np.zeros(n, complex), np.full(n, 0.9, complex), 0, 0, b""
    for tick in range(2500):
        now_us = (now_us + TICK_US) & 0xFFFFFFFF
        if tick % 25 == 0:
            pole = np.exp(-rng.uniform(90, 500, n) * 5e-4 + 1j * rng.uniform(-0.1, 0.1, n))
        if tick % 20 == 0:  # plates and models that are so wrong are faults now and then
            twins.receive(encode(ClearFault()), now_us)
        if tick % 250 == 200:  # the host is silent, so that a tool may begin
            twins.receive(device.encode(HelloRequest()), now_us)
        if (tick % 20 < 3 or rng.random() < 0.02) and tick % 250 < 200:
            seq += 1
            twins.receive(polyline(rng, seq, now_us, n), now_us)
        if rng.random() < 0.05:
            twins.receive(SOMETHING_ELSE[rng.integers(len(SOMETHING_ELSE))], now_us)
        measured = plate_um + rng.normal(0, 1e-3, n) + 1j * rng.normal(0, 1e-3, n)
        values = measured.astype(np.complex64).view(np.float32)
        voltage_v = twins.tick(now_us, values if rng.random() < 0.99 else rng.choice(EXTREMES, 2 * n))
        plate_um = pole * plate_um - 1j * 5.2 * 5e-4 * (voltage_v[::2] + 1j * voltage_v[1::2])
        driven += bool(np.any(voltage_v))
        said += twins.transmit(now_us)
    assert driven > 1000
    kinds = {type(message).__name__ for message in device.Decoder().feed(said)}
    assert {"BoardStatus", "BoardVerdict", "BoardLog", "SweepPoint", "TelemetrySample"} <= kinds


def planes(words: np.ndarray) -> bytes:
    """The samples of a chunk as the STM32G474's DMA leaves them: each mode's half of its buffer."""
    return b"".join(column.tobytes() + bytes(2 * len(words)) for column in np.ascontiguousarray(words.T))


def frames(words: np.ndarray) -> bytes:
    """And as the STM32H743's three ADCs leave them."""
    return b"".join(np.ascontiguousarray(words[:, at]).tobytes() for at in (slice(3), slice(3, 6), slice(6, 8)))


def spoken_planes(cpu: Cpu, words: int, modes: int) -> np.ndarray:
    return np.frombuffer(cpu.read(OUT, 4 * modes * words), "<u2").reshape(modes, 2, words)[:, 0].T


def spoken_frames(cpu: Cpu, words: int, _modes: int) -> np.ndarray:
    """Commands and levels of two chips of DACs; the last command of a sample moves all."""
    found = np.frombuffer(cpu.read(OUT, 32 * words), "<u4").reshape(2, words, 4)
    assert np.array_equal(found[0] >> 16, np.tile([0, 1, 2, 0x13], (words, 1)))
    return np.hstack([*found]) >> 4 & 0xFFF


@pytest.mark.parametrize(
    ("board", "own", "laid", "spoken", "words"),
    [(G474, "planar", planes, spoken_planes, 50), (H743, "framed", frames, spoken_frames, 16)],
)
def test_a_boards_own_way_through_its_samples_gives_the_cores_bits(
    board: Chip, own: str, laid: Callable[..., bytes], spoken: Callable[..., np.ndarray], words: int
) -> None:
    """The state of the carrier, and the levels, of functions of the same image."""
    cpu, modes = fresh_cpu(board), board.modes
    core, mine, out = OBJECT, OBJECT + 0x2000, OBJECT + 0x4000
    rng, levels = np.random.default_rng(4), set()
    for carrier in (core, mine):
        assert cpu.call("hd_carrier_init", carrier, CONVERTERS) & 0xFF
    for i in range(200):
        if i % 4 == 0:
            cpu.write(IN, rng.normal(0, 90, 2 * modes).astype("<f4").tobytes())
            for carrier in (core, mine):
                cpu.call("hd_carrier_drive", carrier, IN)
        samples = rng.integers(0, 4096, (words, modes)).astype("<u2")
        cpu.write(IN, samples.tobytes())
        ready = cpu.call("hd_carrier_listen", core, IN) & 0xFF
        cpu.write(IN, laid(samples))
        assert cpu.call(f"{own}_listen", mine, IN) & 0xFF == ready
        cpu.call("hd_carrier_speak", core, out)
        asked = np.frombuffer(cpu.read(out, 2 * modes * words), "<u2").reshape(words, modes)
        cpu.write(IN, struct.pack("<II", OUT, OUT + 16 * words))  # of the chips of DACs
        cpu.call(f"{own}_speak", mine, OUT if own == "planar" else IN)
        assert np.array_equal(spoken(cpu, words, modes), asked)
        assert cpu.read(core, 400) == cpu.read(mine, 400)
        levels.update(asked.ravel().tolist())
    assert len(levels) > 500
