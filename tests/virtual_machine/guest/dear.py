"""Two users who publish the dearest scenes (`published`), each a program of its own: `dear.py KIND USER_ID DIRECTORY`.

Each message differs from the one before, so that nothing of it can be kept. All are legal; what exceeds a user's share
is refused item by item.
"""

from __future__ import annotations

import itertools
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import msgpack
import zmq

PIPE = subprocess.PIPE
USER_IDS = (64445, 64446)
EVERY_S = 0.002  # the rate limit of a process: 500 messages a second
NAMES = 4  # of one user
VARIANTS = 3
POINTS, SPEED_MM_S, REACH_MM = 64, 2000.0, 45.0
NOISE = {"shortest_mm": 2.0, "longest_mm": 50.0, "mean_um": 0.6, "rms_um": 0.2}

Fields = dict[str, Any]


def path(seed: int) -> Fields:
    """Zigzags whose corners a finger passes one after the other within one frame."""
    angles_rad = [0.7 * seed + 2.4 * n for n in range(POINTS)]
    points = [
        [REACH_MM * math.sin(0.05 * n) * math.cos(angle), REACH_MM * math.sin(angle)]
        for n, angle in enumerate(angles_rad)
    ]
    return {"path_mm": points, "speed_mm_s": SPEED_MM_S, "loop": True}


def virtuals(client: str, count: int, variant: int) -> Fields:
    """Virtual fingers that slip, of which two in three meet a texture."""
    names = [f"{client}.{n}" for n in range(count)]
    contents: list[Fields] = [
        {"amplitude_um": 1.0},
        {"noise": {**NOISE, "seed": variant}},
        {"grating": {"period_mm": 2.0, "high_um": 1.0, "duty_frac": 0.5}},
    ]
    return {
        "virtuals": [{"name": name, **path(n + 100 * variant)} for n, name in enumerate(names)],
        "targets": [{"finger": name, **contents[n % len(contents)]} for n, name in enumerate(names)],
    }


def surface(n: int, variant: int) -> Fields:
    shape = {"polygon_mm": [[40.0 * math.cos(0.39 * k), 30.0 * math.sin(0.39 * k)] for k in range(16)]} if n % 4 else {}
    noise = {"noise": {**NOISE, "seed": n + 16 * variant}}
    pose = {"turning_rad_s": 30.0, "z": n, "blend": ("replace", "add", "max")[n % 3]}
    return {"name": f"s{n}", **noise, **path(n + 50 * variant), **pose, **shape}


def effect(n: int, variant: int) -> Fields:
    wave = {
        "modulation": {"frequency_hz": 40.0, "depth": 0.5, "shape": "square"},
        "start": {"cause": "now", "id": variant},
    }
    pulse = {"pulse": {"height_um": 0.2, "length_s": 0.01}, "surface": f"s{n}"}
    return {"name": f"e{n}", **(pulse | {"start": {"cause": "crossing", "surface": f"s{n}"}} if n % 2 else wave)}


def slipping(client: str, variant: int) -> Fields:
    """Eight slipping virtual fingers."""
    return virtuals(client, 8, variant)


def crowded(client: str, variant: int) -> Fields:
    """As much of everything as a message may have."""
    layers = {"surfaces": [surface(n, variant) for n in range(16)], "effects": [effect(n, variant) for n in range(16)]}
    return virtuals(client, 16, variant) | layers


KINDS = {one.__name__: one for one in (slipping, crowded)}


@contextmanager
def published(kind: str, runtime_dir: Path) -> Iterator[None]:
    """Both publish meanwhile. They begin when both have their messages, for which a busy processor has no time."""
    with ExitStack() as stack:
        publishers = [stack.enter_context(_publisher(kind, user_id, runtime_dir)) for user_id in USER_IDS]
        for publisher in publishers:
            assert publisher.stdin is not None
            publisher.stdin.write("go\n")
            publisher.stdin.flush()
        yield


@contextmanager
def _publisher(kind: str, user_id: int, runtime_dir: Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, __file__, kind, str(user_id), str(runtime_dir)]
    with subprocess.Popen(command, stdin=PIPE, stdout=PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            if process.stdout.readline() != "ready\n":
                raise RuntimeError(f"{kind}: a publisher ended before it began")
            yield process
        finally:
            process.kill()


def main(kind: str, user_id: str, directory: str) -> None:
    """Print `ready`, wait for a line, and publish until killed, as fast as the rate limit allows."""
    names = [f"{user_id}.{n}" for n in range(NAMES)]
    messages = [
        msgpack.packb({"v": 1, "client": name, "ttl_s": 1.0, **KINDS[kind](name, variant)})
        for variant, name in itertools.product(range(VARIANTS), names)
    ]
    os.setgroups([os.stat(directory).st_gid])  # who may open the sockets
    os.setuid(int(user_id))
    sender = zmq.Context().socket(zmq.PUSH)
    sender.immediate = True
    sender.connect(f"ipc://{directory}/targets")
    print("ready", flush=True)
    sys.stdin.readline()
    for message in itertools.cycle(messages):
        sender.send(message)
        time.sleep(EVERY_S)


if __name__ == "__main__":
    main(*sys.argv[1:])
