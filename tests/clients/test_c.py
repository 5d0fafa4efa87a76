"""The C client under sanitizers, against hostile bytes, and from another language."""

from __future__ import annotations

import ctypes
import os
import random
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from asynchronous import PATIENCE_S
from c_client import FOLDER, SANITIZERS, compiled
from fake_daemon import FakeDaemon

from hapticd.wire import client as wire
from hapticd_contract.states import FingerState, PlateState

REFUSED, GONE = 1, 2
STATE = PlateState(
    7, 512, 2**62, "ACTIVE", (FingerState(3, -20.5, 4.0, None, None, 1.0, 0.9, False, "a"),), (1.9,), False, 10.4, 16.1
)
MESSAGES = 20_000


def test_hostile_bytes_make_it_read_nothing_beyond_them(tmp_path: Path) -> None:
    made = compiled(tmp_path, *SANITIZERS, str(Path(__file__).with_name("read_c.c")))
    sound = [
        wire.encode_state(STATE),
        wire.encode_reply(1, {"t_ns": 5, "list": [1, [2.5, None]], "bytes": b"abc"}),
        wire.encode_error(1, "No."),
        msgspec.msgpack.encode({"v": 1, "fingers": [{"id": -5, "x_mm": -(2**40)}] * 40, "deep": [[[[[[]]]]]]}),
        b"\xdf\xff\xff\xff\xff\xa1v\x01",
        b"\x81\xa1v" + b"\x91" * 60_000,
    ]
    chance = random.Random(1)
    lines = [one.hex() for one in sound]
    for _ in range(MESSAGES):
        changed = bytearray(chance.choice(sound[:4]))
        for _ in range(chance.randrange(1, 5)):
            changed[chance.randrange(len(changed))] = chance.randrange(256)
        lines.append(bytes(changed[: chance.randrange(len(changed) + 1)] if chance.random() < 0.3 else changed).hex())
    done = subprocess.run([made], input="\n".join(lines), capture_output=True, text=True, timeout=PATIENCE_S * 4)
    assert done.returncode == 0, done.stderr
    messages, states = map(int, done.stdout.split())
    assert messages == len(lines)
    assert 100 < states < messages


class Finger(ctypes.Structure):
    _fields_ = (
        ("id", ctypes.c_uint32),
        ("name", ctypes.c_char * 129),
        ("owner", ctypes.c_char * 129),
        *[(name, ctypes.c_double) for name in ("x_mm", "y_mm", "target_um", "achieved_um", "felt_friction")],
    )


class State(ctypes.Structure):
    _fields_ = (
        *[(name, ctypes.c_uint64) for name in ("instance", "seq", "t_ns")],
        ("state", ctypes.c_char * 17),
        ("limited", ctypes.c_int),
        ("age_ms", ctypes.c_double),
        ("fingers", ctypes.c_size_t),
        ("finger", Finger * 32),
    )


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ctypes.CDLL]:
    made = compiled(tmp_path_factory.mktemp("c"), "-O2", "-shared", "-fPIC", str(FOLDER / "hapticd.c"))
    loaded = ctypes.CDLL(str(made))
    loaded.hapticd_open.restype = ctypes.c_void_p
    loaded.hapticd_open.argtypes = (ctypes.c_char_p, ctypes.c_char_p, ctypes.c_double)
    loaded.hapticd_error.restype = ctypes.c_char_p
    for name in ("hapticd_close", "hapticd_error", "hapticd_refresh", "hapticd_release_all"):
        getattr(loaded, name).argtypes = (ctypes.c_void_p,)
    loaded.hapticd_set_friction.argtypes = (ctypes.c_void_p, ctypes.c_uint32, ctypes.c_double)
    loaded.hapticd_read.argtypes = (ctypes.c_void_p, ctypes.POINTER(State), ctypes.c_double)
    return loaded


def test_a_finger_that_lifted_is_forgotten_so_that_others_find_room(library: ctypes.CDLL, daemon: FakeDaemon) -> None:
    plate = library.hapticd_open(str(daemon.directory).encode(), b"ctypes", PATIENCE_S)
    state = State()
    for finger in range(1, 40):
        daemon.fingers = {finger: (0.0, 0.0)}
        assert library.hapticd_set_friction(plate, finger, 0.2) == 0, library.hapticd_error(plate)
        while True:
            assert library.hapticd_read(plate, state, PATIENCE_S) == 0
            if state.fingers == 1 and state.finger[0].id == finger:
                break
    library.hapticd_close(plate)


def test_without_a_daemon_it_says_so_and_every_call_is_harmless(library: ctypes.CDLL, tmp_path: Path) -> None:
    plate = library.hapticd_open(str(tmp_path).encode(), b"ctypes", 0.05)
    assert b"No hapticd answers at " in library.hapticd_error(plate)
    assert library.hapticd_set_friction(plate, 1, 0.2) == GONE
    assert library.hapticd_read(plate, State(), 0.01) == GONE
    library.hapticd_refresh(plate)
    library.hapticd_close(plate)
    library.hapticd_close(None)


def test_the_readme_s_commands_run_as_printed_in_a_copy_of_the_folder(daemon: FakeDaemon, tmp_path: Path) -> None:
    compiled(tmp_path, str(FOLDER / "hapticd.c"), str(FOLDER / "program.c"))  # without a warning, where it can be
    folder = tmp_path / "c"
    shutil.copytree(FOLDER, folder)
    blocks = dict(re.findall(r"```(sh|python)\n(.*?)```", (folder / "README.md").read_text("utf-8"), re.DOTALL))
    daemon.fingers = {3: (-20.5, 4.0)}
    environment = {**os.environ, "HAPTICD_RUNTIME_DIR": str(daemon.directory)}
    for command in (["sh", "-ec", blocks["sh"]], [sys.executable, "-c", blocks["python"]]):
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=100)
        assert done.returncode == 0, done.stderr
        assert {*done.stdout.splitlines()} in ({"finger 3 at -20.5, 4.0 mm"}, {"0"})
